"""Poses in flight: on to the estimator, missing, jumping, no numbers, and of a camera process that dies."""

from __future__ import annotations

import asyncio
import math
import os
import signal
import time

import pytest

from companion.core.clock import NS_PER_S
from tests.faults.campaigns import runs
from tests.faults.figures import record
from tests.sitl.flying import Flying

pytestmark = pytest.mark.asyncio(loop_scope="package")


async def test_poses_reach_the_estimator_at_their_rate_in_its_axes(flying: Flying) -> None:
    await flying.fly()
    begin = await flying.px4()
    await asyncio.sleep(2.0)
    end = await flying.px4()
    rate_hz = (end.vision - begin.vision) * NS_PER_S / (end.t_mono_ns - begin.t_mono_ns)
    assert 25 <= rate_hz <= 32 and end.vision_age_s is not None and abs(end.vision_age_s) < 0.3
    assert end.vision_p_enu_m is not None
    # Where the camera began is not where the autopilot did: the height above the ground and the way flown agree.
    assert math.dist(end.vision_p_enu_m, end.p_enu_m) < 1.0


async def test_fault_17_a_gap_of_the_poses_holds_the_vehicle(flying: Flying) -> None:
    await flying.fly("acquiring", "approaching")
    flying.camera("pause")
    since_s = time.monotonic()
    await flying.in_state("holding", timeout_s=5.0)
    stale_s = time.monotonic() - since_s
    await asyncio.sleep(runs(3, 7) - stale_s)
    held = await flying.px4()
    flying.camera("pass")
    await flying.until(lambda status: status["health"]["poses"]["gap"] > 0, 5.0)
    record(17, holding_after_s=round(stale_s, 2), gap_s=runs(3, 7))
    assert stale_s <= 0.2 + 0.25 and math.hypot(*held.v_enu_m_s) < 0.3
    await flying.fly("acquiring", "approaching")


async def test_fault_18_a_jump_of_the_poses_drops_the_aperture_and_moves_nothing(flying: Flying) -> None:
    await flying.fly("acquiring", "approaching")
    await flying.until(lambda status: status["path_m"] > 0.2, 20.0)
    begin = await flying.px4("forget gaps")
    flying.camera("jump 1.0")
    speed_m_s, steps = 0.0, 30
    for _ in range(steps):
        await asyncio.sleep(0.05)
        speed_m_s = max(speed_m_s, math.hypot(*(await flying.px4()).v_enu_m_s))
    end = await flying.px4()
    status = await flying.status()
    log = (flying.out / "uav.txt").read_text()
    record(18, top_speed_after_m_s=round(speed_m_s, 2), jumps=status["health"]["poses"]["jump"])
    assert status["health"]["poses"]["jump"] == 1
    # What the estimator gets goes on without the jump, so nothing is to be set anew by it.
    assert begin.vision_reset_counter == end.vision_reset_counter == 0
    assert begin.vision_p_enu_m is not None and end.vision_p_enu_m is not None
    assert math.dist(begin.vision_p_enu_m, end.vision_p_enu_m) < 0.9 + math.dist(begin.p_enu_m, end.p_enu_m)
    assert end.setpoints > begin.setpoints and speed_m_s < 0.8  # legs are flown at 0.5 m/s
    if "refused: poses: jump" not in log:
        await flying.until(lambda _: "refused: poses: jump" in (flying.out / "uav.txt").read_text(), 15.0)


async def test_fault_19_a_dead_camera_process_holds_and_is_replaced(flying: Flying) -> None:
    await flying.fly("acquiring", "approaching")
    (camera,) = flying.children("tests.faults.pose_relay")
    os.kill(camera, signal.SIGKILL)
    since_s = time.monotonic()
    await flying.in_state("holding", timeout_s=3.0)
    held_s = time.monotonic() - since_s
    await flying.until(lambda _: flying.children("tests.faults.pose_relay") not in ([], [camera]), 10.0)
    restarted_s = time.monotonic() - since_s
    # Its frame has a new yaw: poses wait until the autopilot's heading has told where North is.
    await flying.until(lambda status: not any("poses" in t or "North" in t for t in status["not_ready"]), 20.0)
    back_s = time.monotonic() - since_s
    record(
        19, holding_after_s=round(held_s, 2), restarted_after_s=round(restarted_s, 2), poses_after_s=round(back_s, 1)
    )
    assert held_s < 0.6 and restarted_s <= 5.0


async def test_fault_16_poses_that_are_no_numbers_land_the_vehicle(flying: Flying) -> None:
    await flying.fly()
    flying.camera("nan")
    since_s = time.monotonic()
    status = await flying.in_state("landing", timeout_s=3.0)
    lost_s = time.monotonic() - since_s
    await flying.until(lambda _: flying.now.vehicle.mode == "LAND", 5.0)
    seen = (await flying.px4()).vision
    await asyncio.sleep(0.2)
    assert (await flying.px4()).vision == seen, "what is no number is not for the estimator"
    flying.camera("pass")
    record(16, lost_after_s=round(lost_s, 2), then="land")
    assert status["reason"] == "pose_lost"
    assert lost_s <= 0.1 + 0.15  # the status is asked for every 20 ms, and the tick is 50 ms
    await flying.let_go()
