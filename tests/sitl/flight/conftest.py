"""The one cast, since it takes seconds to start."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from tests.sitl.flying import Flying
from tests.sitl.flying import flying as running


@pytest_asyncio.fixture(loop_scope="package", scope="package")
async def flying(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Flying]:
    autopilot = {"engage_rc_channel": 3, "forward_vio_hz": 30.0}
    async with running(tmp_path_factory.mktemp("flight"), autopilot=autopilot) as started:
        yield started
