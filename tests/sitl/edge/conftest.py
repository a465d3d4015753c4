"""An autopilot for each test, and the edge connected to it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.core.clock import MonotonicClock
from companion.sim.stage import free_udp_port
from tests.sitl.edge import OPTIONS
from tests.sitl.px4_process import Px4Process


@pytest.fixture
def port() -> int:
    return free_udp_port("127.0.0.1")


@pytest.fixture
def px4(port: int, tmp_path: Path) -> Iterator[Px4Process]:
    with Px4Process(port, tmp_path, *OPTIONS) as process:
        yield process


@pytest.fixture
async def autopilot(px4: Px4Process, port: int) -> AsyncIterator[MavsdkAutopilot]:
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", MonotonicClock())
    await edge.connect()
    yield edge
    await edge.aclose()
