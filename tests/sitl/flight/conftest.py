"""The one cast, since it takes seconds to start."""

from __future__ import annotations

import socket
from collections.abc import AsyncIterator
from contextlib import nullcontext

import pytest
import pytest_asyncio

from companion.config.schema import FoxgloveConfig, PageConfig
from tests.sitl.flying import Flying
from tests.sitl.flying import flying as running
from tests.sitl.ground_link import GroundLink


@pytest_asyncio.fixture(loop_scope="package", scope="package")
async def flying(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Flying]:
    autopilot = {"engage_rc_channel": 3, "forward_vio_hz": 30.0, "ground_hz": 2.0}
    with socket.socket() as probe, socket.socket() as other:
        probe.bind(("127.0.0.1", 0))
        other.bind(("127.0.0.1", 0))
        page = PageConfig(enabled=True, port=probe.getsockname()[1])
        # Team, TAK, the live server and a ground station cost the flight processor; the flights that are about them are
        # long tests.
        beside = request.config.getoption("markexpr") != "not long"
        live = FoxgloveConfig(enabled=beside, port=other.getsockname()[1])
    folder = tmp_path_factory.mktemp("flight")
    with GroundLink() if beside else nullcontext() as ground:
        options = () if ground is None else ground.options
        async with running(
            folder,
            autopilot=autopilot,
            page=page,
            px4_options=options,
            foxglove=live,
            beside=beside,
            hold_limit_s=600.0,  # on a slow machine bearings may stay away for longer than a test of one mission waits
        ) as started:
            started.ground = ground
            yield started
