"""A flight with its page, which is killed, stopped and looked at by many: set points go out as before."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import urllib.request
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from tests.sitl.flying import IN_OFFBOARD, Flying, flies_on

pytestmark = pytest.mark.asyncio(loop_scope="package")
_PAGE = "companion.page.server"
_PATIENCE_S = 60.0


async def test_fault_50_a_page_killed_stopped_or_besieged_costs_the_flight_nothing(flying: Flying) -> None:
    await flying.fly()
    port = flying.stage.uav.page.port
    view = await _seen(port, lambda view: view["vehicle"] is not None and view["mission"]["state"] in IN_OFFBOARD)
    assert view["vehicle"]["mode"] == "offboard"
    pid = _page_pid(flying)
    first = await flying.px4()
    os.kill(pid, signal.SIGSTOP)
    writers = [(await asyncio.open_connection("127.0.0.1", port))[1] for _ in range(40)]
    for writer in writers:
        writer.write(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 20)
    await asyncio.sleep(2.0)
    os.kill(pid, signal.SIGCONT)
    await _seen(port, lambda view: view["introduced"])
    for writer in writers:
        writer.close()
    os.kill(pid, signal.SIGKILL)
    await _seen(port, lambda view: view["introduced"] and _page_pid(flying) != pid)
    last = await flying.px4()
    status = await flying.status()
    assert flies_on(status), (status["state"], status["reason"])
    assert last.mode in ("OFFBOARD", "HOLD") and last.setpoints > first.setpoints
    assert last.largest_gap_s < 0.5


def _page_pid(flying: Flying) -> int:
    return max(flying.children(_PAGE), default=0)


async def _seen(port: int, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    async with asyncio.timeout(_PATIENCE_S):
        while True:
            with suppress(OSError):
                view = await asyncio.to_thread(_look, port)
                if is_so(view):
                    return view
            await asyncio.sleep(0.1)


def _look(port: int) -> dict[str, Any]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/state", timeout=10) as answer:
        return json.loads(answer.read())["view"]  # type: ignore[no-any-return]
