"""The service on a real PX4, and faults with what PX4 itself must do then: `python -m pytest -m px4`.

It starts no PX4: docs/testing.md says what must run. Which half flies depends on its SYS_HAS_GPS. One cast for all;
each test finds the vehicle armed in the air or on the ground, in hold, and leaves it to the next.
"""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import suppress

import pytest
import pytest_asyncio
from pymavlink.dialects.v20 import development as mavlink

from companion.core.messages import FlightMode
from tests.sitl.real_cast import RESTART, Real, real_cast

pytestmark = [pytest.mark.px4, pytest.mark.asyncio(loop_scope="module")]

_POSITION = 3
_COMPANION_DEAD_S = 1.5
"""COM_OF_LOSS_T, and half a second for PX4 to see it and to tell."""


@pytest_asyncio.fixture(loop_scope="module", scope="module")
async def real(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Real]:
    async with real_cast(tmp_path_factory.mktemp("px4"), lost_target="land") as cast:
        yield cast


async def test_wrong_parameters_are_refused_by_name_and_nothing_is_armed(real: Real) -> None:
    wrong = {"COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 3.0, "RTL_RETURN_ALT": 30.0, "SYS_HAS_GPS": 0 if real.gps else 1}
    right = {name: await real.px4.parameter(name) for name in wrong}
    await real.flight.until(lambda status: not status["not_ready"], 120.0)
    try:
        for name, value in wrong.items():
            await real.px4.set(name, value)
        answer = await real.flight.command("engage")
    finally:
        for name, value in right.items():
            await real.px4.set(name, value)
    assert not answer["ok"]
    for name in wrong:
        assert f"parameter {name} is" in answer["error"]
    assert not real.px4.armed and not real.px4.setpoints


async def test_it_is_engaged_on_the_ground_and_finds_the_target(real: Real) -> None:
    """From the ground to the rendezvous, in OFFBOARD at 20 set points a second, then held by PX4 until it is landed."""
    began_s = time.monotonic()
    await real.fly()
    await real.flight.in_state("approaching", timeout_s=120.0)
    height_m = real.flight.stage.uav.mission.takeoff_height_m
    assert abs(real.px4.p_enu_m[2] - height_m) < 0.8  # PX4's own estimate is half a metre off; its default is 1 m more
    from_s = time.monotonic()
    try:
        status = await real.flight.in_state("arrived", timeout_s=240.0)
    finally:
        print(f"mission: nearest {min(world.distance_m for world in real.flight.truths):.2f} m")
    rate_hz = sum(t_s > from_s for t_s in real.px4.setpoints) / (time.monotonic() - from_s)
    took_s, distance_m = time.monotonic() - began_s, real.flight.now.distance_m
    print(f"mission: {took_s:.0f} s from engaging to the rendezvous, at {distance_m:.2f} m, {rate_hz:.1f} set points/s")
    assert rate_hz == pytest.approx(20.0, abs=1.0) and status["vehicle"]["in_air"]
    assert distance_m < 3.0
    await real.px4.in_mode(FlightMode.HOLD, timeout_s=2.0)
    await real.never_back(time.monotonic())
    await real.flight.let_go()
    await real.land()


async def test_an_abort_leaves_it_in_hold(real: Real) -> None:
    await real.fly()
    at_s = time.monotonic()
    assert (await real.flight.command("abort"))["ok"]
    print(f"abort: hold after {await real.px4.in_mode(FlightMode.HOLD, timeout_s=1.0):.2f} s")
    await real.flight.in_state("latched", timeout_s=3.0)
    await real.never_back(at_s + 0.2)


async def test_a_pilot_who_changes_the_mode_is_obeyed(real: Real) -> None:
    await real.fly()
    assert await real.px4.choose(_POSITION) == mavlink.MAV_RESULT_ACCEPTED
    await real.px4.in_mode(FlightMode.MANUAL, timeout_s=1.0)
    at_s = time.monotonic()
    await real.flight.in_state("latched", timeout_s=2.0)
    print(f"pilot: last set point {max(real.px4.setpoints) - at_s:.2f} s after the mode")
    await real.never_back(at_s + 0.5)
    assert real.px4.mode is FlightMode.MANUAL
    await real.settle()


async def test_kill_9_leaves_it_to_px4_and_a_new_service_starts_idle(real: Real) -> None:
    await real.fly()
    await real.flight.kill()
    at_s = time.monotonic()
    took_s = await real.px4.in_mode(real.left_to, timeout_s=_COMPANION_DEAD_S + 1.0)
    print(f"kill -9: {real.left_to} after {took_s:.2f} s")
    await real.flight.restart()
    await real.never_back(at_s, 5.0)
    assert (await real.flight.status())["state"] == "idle"


async def test_a_stop_of_3_s_is_not_made_up_for(real: Real) -> None:
    await real.fly()
    service = real.flight.cast.pid("uav")
    os.kill(service, signal.SIGSTOP)
    try:
        at_s = time.monotonic()
        took_s = await real.px4.in_mode(real.left_to, timeout_s=2.5)
        await asyncio.sleep(at_s + 3.0 - time.monotonic())
    finally:
        os.kill(service, signal.SIGCONT)
    print(f"SIGSTOP: {real.left_to} after {took_s:.2f} s")
    await real.flight.in_state("latched", timeout_s=3.0)
    await real.never_back(at_s + 0.1)


async def test_a_lost_link_leaves_it_to_px4(real: Real) -> None:
    await real.fly()
    real.px4.is_cut = True
    try:
        at_s = time.monotonic()
        took_s = await real.px4.in_mode(real.left_to, timeout_s=_COMPANION_DEAD_S + 1.0)
        print(f"link lost: {real.left_to} after {took_s:.2f} s")
        await real.flight.in_state("latched", timeout_s=10.0)
        stopped_s = time.monotonic()
        print(f"link lost: latched after {stopped_s - at_s:.2f} s")
    finally:
        real.px4.is_cut = False
    await real.never_back(stopped_s + 0.1, 5.0)


async def test_lost_poses_bring_it_down_before_px4_is_blind(real: Real) -> None:
    """With GPS it stands, with poses alone it lands while PX4 still knows where it is; never in OFFBOARD again."""
    if real.gps:
        pytest.skip("SYS_HAS_GPS is 1: PX4 does not fly by the poses")
    await real.fly()
    real.flight.camera("pause")
    try:
        at_s = time.monotonic()
        took_s = await real.px4.in_mode(FlightMode.LAND, timeout_s=4.5)
        print(f"poses lost: land after {took_s:.2f} s, estimator flags {real.px4.told['ESTIMATOR_STATUS'].flags}")
        await real.px4.down()
    finally:
        with suppress(OSError):  # the service has started its silent camera again, which passes
            real.flight.camera("pass")
    await real.never_back(at_s + 4.5)


async def test_px4s_own_fence_takes_it_out_of_offboard(real: Real) -> None:
    await real.fly()
    before = await real.px4.parameter("GF_MAX_VER_DIST")
    at_s = time.monotonic()
    try:
        await real.px4.set("GF_MAX_VER_DIST", 0.5)
        await real.px4.in_mode(FlightMode.HOLD, FlightMode.LAND, timeout_s=5.0)
        out_s = time.monotonic()
        print(f"fence: {real.px4.mode} after {out_s - at_s:.2f} s")
        await real.flight.in_state("latched", timeout_s=3.0)
        await real.never_back(out_s + 0.5)
        if not real.gps:  # GF_ACTION 5: PX4 holds for COM_FAIL_ACT_T first, then lands
            await real.px4.in_mode(FlightMode.LAND, timeout_s=8.0)
    finally:
        await real.px4.set("GF_MAX_VER_DIST", before)


async def test_a_restarted_px4_is_asked_for_everything_again(real: Real) -> None:
    """In the air where the restart is ours to make: the flight is over for us, and a person may begin the next."""
    await real.fly()
    if RESTART not in os.environ:  # PX4 itself refuses to, while it flies
        await real.flight.let_go()
        await real.land()
    at_s = time.monotonic()
    await real.restart()
    await real.flight.in_state("latched", timeout_s=5.0)
    print(f"restart: last set point {max(real.px4.setpoints) - at_s:.2f} s after it")
    await real.never_back(at_s + 2.0, 10.0)
    assert (await real.flight.status())["state"] == "latched"
    began_s = time.monotonic()
    await real.flight.until(lambda status: not status["not_ready"], 120.0)
    print(f"restart: ready again after {time.monotonic() - began_s:.0f} s more")
    await real.fly()
    await real.flight.let_go()
    await real.land()


async def test_a_low_battery_brings_it_down(real: Real) -> None:
    """PX4's own answer is to land (COM_LOW_BAT_ACT 2); whoever is first, the vehicle comes down and stays down."""
    names = {"COM_LOW_BAT_ACT": 2, "SIM_BAT_DRAIN": 1.0, "SIM_BAT_MIN_PCT": 4.0}
    await real.fly()
    before = {name: await real.px4.parameter(name) for name in names}
    at_s = time.monotonic()
    try:
        for name, value in names.items():
            await real.px4.set(name, value)
        await real.px4.in_mode(FlightMode.LAND, timeout_s=20.0)
        out_s = time.monotonic()
        print(f"battery: land after {out_s - at_s:.2f} s, the service is {(await real.flight.status())['state']}")
        await real.px4.down()
        await real.never_back(out_s + 0.5)
    finally:
        for name, value in before.items():
            await real.px4.set(name, value)
