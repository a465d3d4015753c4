"""A flight with its streams live to a viewer: the server stopped, besieged and killed, set points go out as before."""

from __future__ import annotations

import asyncio
import os
import signal

import pytest

from companion.roles.live import LIVE
from tests.live_viewer import viewing
from tests.sitl.flying import Flying, flies_on

pytestmark = pytest.mark.asyncio(loop_scope="package")
_SHOWN = ("/vehicle", "/bearing", "/setpoint", "/tf", "/mission")


@pytest.mark.long
async def test_fault_55_a_live_server_stopped_besieged_and_killed_costs_the_flight_nothing(flying: Flying) -> None:
    await flying.fly()
    port = flying.stage.uav.foxglove.port
    async with viewing(f"ws://127.0.0.1:{port}") as viewer, asyncio.timeout(60.0):
        while not set(_SHOWN) <= set(viewer.channels):  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)
        await viewer.subscribe(_SHOWN)
        while not {"/vehicle", "/bearing", "/setpoint", "/tf"} <= set(viewer.messages):  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)
        await flying.px4("forget gaps")
        first, pid = await flying.px4(), _server(flying)
        os.kill(pid, signal.SIGSTOP)
        writers = [(await asyncio.open_connection("127.0.0.1", port))[1] for _ in range(40)]
        for writer in writers:
            writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 20)
        await asyncio.sleep(2.0)
        os.kill(pid, signal.SIGCONT)
        await asyncio.sleep(0.5)
        for writer in writers:
            writer.close()
        os.kill(pid, signal.SIGKILL)
        while _server(flying) in (0, pid):  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)
    last, status = await flying.px4(), await flying.status()
    assert flies_on(status), (status["state"], status["reason"])
    assert last.mode in ("OFFBOARD", "HOLD") and last.setpoints > first.setpoints
    print(f"largest gap {last.largest_gap_s:.3f} s")
    assert last.largest_gap_s < 0.5


def _server(flying: Flying) -> int:
    return max(flying.children(LIVE), default=0)
