"""A flight that tells TAK: the vehicle is where its GPS says, and a sender that is killed costs the flight nothing."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
from collections.abc import Callable

import pytest

from tests.cot import Cot, read_cot
from tests.sitl.flying import Flying, flies_on

pytestmark = pytest.mark.asyncio(loop_scope="package")
_SENDER = "companion.tak.sender"
_PATIENCE_S = 60.0


@pytest.mark.long
async def test_fault_60_tak_killed_or_stopped_costs_the_flight_nothing(flying: Flying) -> None:
    await flying.fly()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", flying.stage.uav.tak.port))
        listener.setblocking(False)
        own = await _told(listener, lambda event: event.kind == "a-f-A-M-H-Q")
        assert (own.point["lat"], own.point["lon"]) == pytest.approx((47.3977, 8.5456), abs=2e-3)
        assert own.point["ce"] == 0.8 and own.point["hae"] > 530.0
        await _told(listener, lambda event: event.uid.endswith((".bearing", ".target")))
        (pid,) = flying.children(_SENDER)
        first = await flying.px4()
        os.kill(pid, signal.SIGSTOP)
        await asyncio.sleep(2.0)
        os.kill(pid, signal.SIGKILL)
        async with asyncio.timeout(_PATIENCE_S):
            while flying.children(_SENDER) in ([pid], []):  # noqa: ASYNC110 - it is polled
                await asyncio.sleep(0.1)
        await _told(listener, lambda event: event.time > own.time)
    last = await flying.px4()
    status = await flying.status()
    assert flies_on(status), (status["state"], status["reason"])
    assert last.mode in ("OFFBOARD", "HOLD") and last.setpoints > first.setpoints
    assert last.largest_gap_s < 0.5


async def _told(listener: socket.socket, is_so: Callable[[Cot], bool]) -> Cot:
    async with asyncio.timeout(_PATIENCE_S):
        while True:
            event = read_cot(await asyncio.get_running_loop().sock_recv(listener, 65536))
            if is_so(event):
                return event
