"""Bearings that stay away in flight: the worker hangs or dies, the ground robot falls silent."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import time

import pytest

from companion.core.clock import NS_PER_S
from tests.faults.figures import record
from tests.sitl.flying import Flying

pytestmark = pytest.mark.asyncio(loop_scope="package")


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGSTOP,
        # That one which dies is replaced is checked without a flight, in test_worker_process.py.
        pytest.param(signal.SIGKILL, marks=pytest.mark.long),
    ],
    ids=lambda number: number.name,
)
async def test_fault_06_a_worker_that_hangs_or_dies_is_replaced(flying: Flying, number: signal.Signals) -> None:
    await flying.fly("approaching")
    await flying.until(lambda status: status["state"] == "approaching" and not status["bearing_stale"])
    (worker,) = flying.children("companion.sensing.worker")
    begin = await flying.px4("forget gaps")
    os.kill(worker, number)
    since_s = time.monotonic()
    stale_s = await flying.seconds_while(lambda status: not status["bearing_stale"])
    replaced = await flying.until(lambda _: flying.children("companion.sensing.worker") not in ([], [worker]), 30.0)
    restarted_s = time.monotonic() - since_s
    await asyncio.sleep(max(0.0, 2.0 - restarted_s))
    end = await flying.px4()
    rate_hz = (end.setpoints - begin.setpoints) * NS_PER_S / (end.t_mono_ns - begin.t_mono_ns)
    gap_ms = 1000 * end.largest_gap_s
    record(6, stale_after_s=round(stale_s, 2), replaced_after_s=round(restarted_s, 1), gap_ms=round(gap_ms))
    assert stale_s <= 2.0
    assert replaced["streaming"] and rate_hz >= 18 and gap_ms <= 200
    await flying.until(lambda status: "the AOA worker is not ready" not in status["not_ready"], 30.0)


async def test_fault_29_a_silent_ground_robot_is_not_chased(flying: Flying) -> None:
    await flying.fly("approaching")
    await flying.until(lambda status: status["state"] == "approaching" and not status["bearing_stale"])
    os.kill(flying.cast.pid("beacon"), signal.SIGSTOP)
    since_s = time.monotonic()
    await flying.in_state("holding", timeout_s=10.0)
    silent_s = time.monotonic() - since_s
    await asyncio.sleep(1.0)
    held_m = (await flying.px4()).p_enu_m
    await asyncio.sleep(3.0)
    moved_m = math.dist(held_m, (await flying.px4()).p_enu_m)
    os.kill(flying.cast.pid("beacon"), signal.SIGCONT)
    record(29, holding_after_s=round(silent_s, 2), moved_in_3_s_m=round(moved_m, 2))
    assert moved_m < 0.3  # that it then returns shows in test_mission
