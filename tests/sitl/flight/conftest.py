"""The one cast, since it takes seconds to start."""

from __future__ import annotations

import socket
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from companion.config.schema import PageConfig
from tests.sitl.flying import Flying
from tests.sitl.flying import flying as running


@pytest_asyncio.fixture(loop_scope="package", scope="package")
async def flying(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Flying]:
    autopilot = {"engage_rc_channel": 3, "forward_vio_hz": 30.0}
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        page = PageConfig(enabled=True, port=probe.getsockname()[1])
    async with running(tmp_path_factory.mktemp("flight"), autopilot=autopilot, page=page) as started:
        yield started
