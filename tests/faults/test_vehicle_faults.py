"""What the vehicle says of itself decides: faults 31 and on, in virtual time."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.mission.table import State
from companion.sensing.records import Iteration
from companion.sim.px4.commander import Mode
from tests.faults.figures import record
from tests.faults.virtual_flight import VirtualFlight

Start = Callable[..., VirtualFlight]


@pytest.fixture
def start(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Start:
    def begin(gps: bool = True, clock_rate: float = 1.0, **parameters: int | float) -> VirtualFlight:
        return VirtualFlight(
            directory=tmp_path_factory.mktemp("v"),
            out=tmp_path,
            monkeypatch=monkeypatch,
            gps=gps,
            clock_rate=clock_rate,
            **parameters,
        )

    return begin


def _refuses_for(flight: VirtualFlight, problem: str) -> bool:
    return problem in flight.flight.status()["not_ready"]


@asynccontextmanager
async def _flying(flight: VirtualFlight, settle_s: float = 2.0) -> AsyncIterator[VirtualFlight]:
    try:
        async with flight.flight._commands:
            await flight.run(settle_s)
            yield flight
    finally:
        flight.close()


@pytest.mark.parametrize("gps", [True, False])
async def test_fault_34_fault_48_a_whole_flight_from_ground_to_ground_healthy_at_rest_and_in_the_air(
    start: Start, gps: bool
) -> None:
    """PX4 sets CONST_POS_MODE while it stands, and in the air when nothing measures where it is."""
    async with _flying(start(gps)) as flight:
        at_rest = flight.px4.commander.estimator.flags(flight.px4.commander.is_at_rest)
        assert at_rest & 128 and flight.state.estimator_healthy and await flight.engage() == ""
        await flight.until(State.APPROACHING)
        in_air = flight.px4.commander.estimator.flags(flight.px4.commander.is_at_rest)
        assert not in_air & 128 and flight.state.estimator_healthy
        record(48, flags_at_rest=at_rest, flags_in_the_air=in_air, healthy_in_both=True)
        await flight.run(5.0)
        heights_m = [p[2] for p, _ in flight.truths[-60:]]
        lowest_m, highest_m = min(heights_m), max(heights_m)
        assert all(abs(height_m - 1.5) < 0.35 for height_m in heights_m), (min(heights_m), max(heights_m))
        flight.is_heard = False
        await flight.until(State.IDLE, timeout_s=90.0)
        assert State.LANDING in flight.states and max(p[2] for p, _ in flight.truths) < 3.5
        await flight.run(12.0)
        report = flight.report()
        assert report.mode == "HOLD" and not report.armed and not report.failsafe
        away_m = math.hypot(*report.p_enu_m[:2])
        record(34, flown_at_m=f"{lowest_m:.2f} to {highest_m:.2f}", landed_from_its_start_m=round(away_m, 2))


async def test_fault_31_a_second_vehicle_on_the_link_is_left_alone(start: Start) -> None:
    async with _flying(start()) as flight:
        flight.order("stranger 7")
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        (stranger,) = flight.report().strangers
        record(31, set_points_to_the_other=stranger.setpoints, other_armed=stranger.armed)
        assert not stranger.armed and stranger.setpoints == 0 and stranger.mode == "HOLD"
        told = flight.flight.status()["vehicle"]
        assert (told["system_id"], told["autopilot"], told["firmware"]) == (1, "px4", "1.16.1")
        assert flight.flight.wishes.vehicle == "system 1, px4 1.16.1"


async def test_fault_31_a_vehicle_that_is_no_px4_is_not_engaged(start: Start) -> None:
    async with _flying(start()) as flight:
        flight.px4.link.streams._kind = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        await flight.run(1.5)
        assert "the vehicle is no PX4 but ardupilot" in flight.flight.status()["not_ready"]


@pytest.mark.parametrize("gps", [True, pytest.param(False, marks=pytest.mark.long)])
async def test_fault_44_what_px4_itself_would_not_arm_is_refused_with_its_reason(start: Start, gps: bool) -> None:
    async with _flying(start(gps)) as flight:
        assert flight.flight.status()["vehicle"]["can_arm"] is True
        flight.order("checks fail high_accel_bias")
        await flight.run(1.0)
        problem = "PX4's own arming checks fail: estimator high accel bias"
        assert flight.flight.status()["not_ready"] == [problem] and await flight.engage() == problem
        await flight.run(4.0)
        assert "COMMAND_LONG 400" not in flight.px4.link.received and not flight.report().armed
        record(44, refused=True, asked_to_arm=flight.px4.link.received.get("COMMAND_LONG 400", 0))
        flight.order("checks pass")
        await flight.run(1.0)
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)


async def test_fault_44_a_vehicle_that_tells_nothing_of_its_checks_is_refused(start: Start) -> None:
    async with _flying(start()) as flight:
        flight.px4.link.streams._period_ns["SYS_STATUS"] = -1
        silent_s = await flight.seconds_until(lambda: flight.state.can_arm is False)
        record(44, silence_known_after_s=silent_s)
        assert silent_s < 3.6
        problem = "PX4's own arming checks fail: it tells nothing of them (SYS_STATUS)"
        assert flight.flight.status()["not_ready"] == [problem]


@pytest.mark.parametrize(
    "told",
    [
        [
            (["battery 0 0.95", "battery 1 0.05"], "the battery is low: 5 %, wanted 20"),
            (["battery 1 unknown"], "battery 1 is silent, or does not know how full it is"),
            (["battery 0 0.05", "battery 1 0.95"], "the battery is low: 5 %, wanted 20"),
        ],
        [
            (["battery 0 unknown"], "no battery tells how full it is (BATTERY_STATUS)"),
            (["battery 0 0.95"], ""),
            (["battery 0 silent"], "no battery tells how full it is (BATTERY_STATUS)"),
        ],
    ],
    ids=["two", "one"],
)
async def test_fault_32_the_lowest_battery_counts_and_an_unknown_one_refuses(
    start: Start, told: list[tuple[list[str], str]]
) -> None:
    async with _flying(start()) as flight:
        for orders, problem in told:
            for order in orders:
                flight.order(order)
            if not problem:
                await flight.seconds_until(lambda: not flight.flight.status()["not_ready"])
                continue
            after_s = await flight.seconds_until(partial(_refuses_for, flight, problem))
            record(32, ", ".join(orders), known_after_s=after_s)
            await flight.run(2.0)
            assert problem in await flight.engage()
            assert not flight.report().armed


@pytest.mark.parametrize(
    ("parameter", "value"), [("RTL_RETURN_ALT", 30.0), ("NAV_MC_ALT_RAD", 1.5), ("COM_TAKEOFF_ACT", 1)]
)
async def test_fault_33_heights_of_the_autopilots_own_are_looked_at_first(
    start: Start, parameter: str, value: float
) -> None:
    async with _flying(start(**{parameter: value})) as flight:
        before_ns = flight.clock.now_ns()
        assert (await flight.engage()).startswith(f"parameter {parameter} is {value:g}; wanted ")
        record(33, refused_after_s=round((flight.clock.now_ns() - before_ns) / NS_PER_S, 2))
        assert not flight.report().armed


@pytest.mark.parametrize("drift_m", [-0.5, pytest.param(0.5, marks=pytest.mark.long)])
async def test_fault_34_heights_count_from_where_it_stood(start: Start, drift_m: float) -> None:
    """The estimate's Up has wandered; PX4 ends its takeoff below the height and climbs on."""
    async with _flying(start(), 1.0) as flight:
        flight.px4.commander.estimator._drift_m = drift_m
        flight.is_heard = False  # nothing is measured while it stands there
        await flight.run(36.0)
        flight.is_heard = True
        await flight.run(4.0)
        assert flight.state.p_local_enu_m is not None and abs(flight.state.p_local_enu_m[2]) > 0.35
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        await flight.run(6.0)
        assert all(abs(p[2] - 1.5) < 0.3 for p, _ in flight.truths[-40:])


async def test_fault_35_without_gps_it_gets_an_origin_and_is_refused_until_then(start: Start) -> None:
    flight = start(gps=False)
    flight.has_poses = False
    async with _flying(flight, 4.0):
        assert "the autopilot's estimator is not healthy" in flight.flight.status()["not_ready"]
        assert flight.report().received.get("SET_GPS_GLOBAL_ORIGIN", 0) == 0, "not before it takes our poses"
        flight.has_poses = True
        after_s = await flight.seconds_until(lambda: flight.report().has_global_position)
        record(35, origin_after_first_pose_s=after_s)
        await flight.run(max(0.0, 5.0 - after_s))
        report = flight.report()
        assert report.has_global_position and report.received["SET_GPS_GLOBAL_ORIGIN"] == 1
        assert report.vision_dropped == 0
        assert await flight.engage() == ""


async def test_fault_35_a_restarted_vehicle_gets_its_origin_again(start: Start) -> None:
    async with _flying(start(gps=False)) as flight:
        flight.order("reboot 2")
        await flight.run(0.5)
        after_s = 0.5 + await flight.seconds_until(lambda: flight.report().has_global_position)
        record(35, origin_after_restart_s=round(after_s, 2))
        await flight.run(max(0.0, 10.0 - after_s))
        assert flight.state.boots == 1 and flight.report().has_global_position
        assert await flight.engage() == ""


async def test_a_mode_that_was_lost_and_is_back_between_two_ticks_is_not_flown_on(start: Start) -> None:
    """As PX4 does by itself where the stream was late for it and is there again."""
    async with _flying(start()) as flight:
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        for mode in (Mode.HOLD, Mode.OFFBOARD):
            flight.px4.commander.pilot_mode(mode)
            flight.vehicle.run(0.06)
        assert flight.report().mode == "OFFBOARD" and flight.state.offboard_left == 1
        await flight.tick()
        assert flight.flight.state is State.LATCHED
        sent = flight.report().setpoints
        await flight.run(3.0)
        assert flight.report().setpoints == sent and flight.report().mode == "HOLD"
        flight.order("pilot HOLD")
        await flight.run(0.5)
        assert await flight.engage() == "", "a person may"
        await flight.until(State.APPROACHING)


@pytest.mark.parametrize("jump_m", [pytest.param((1.0, 0.0, 0.0), marks=pytest.mark.long), (0.0, -3.0, 0.4)])
async def test_fault_36_without_gps_a_jump_of_the_poses_moves_nothing(
    start: Start, jump_m: tuple[float, float, float]
) -> None:
    async with _flying(start(gps=False)) as flight:
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        flight.is_heard = False
        await flight.until(State.HOLDING)
        await flight.run(1.5)
        here, since = flight.truths[-1][0], len(flight.truths)
        flight.pose_offset_m = jump_m
        await flight.run(2.0)
        assert flight.uav.node.intake.reset_counter == 1
        moved_m, fastest_m_s = math.dist(flight.truths[-1][0], here), flight.top_speed_m_s(since)
        record(36, moved_m=round(moved_m, 3), fastest_m_s=round(fastest_m_s, 3))
        assert moved_m < 0.15 and fastest_m_s < 0.3
        assert flight.report().vision_dropped == 0


@pytest.mark.parametrize("reset_m", [pytest.param((5.0, 0.0, 0.0), marks=pytest.mark.long), (-1.0, 1.0, 0.5)])
async def test_fault_37_an_estimate_that_is_set_anew_moves_our_path_along(
    start: Start, reset_m: tuple[float, float, float]
) -> None:
    async with _flying(start()) as flight:
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        flight.is_heard = False
        await flight.until(State.HOLDING)
        await flight.run(1.5)
        here, since = flight.truths[-1][0], len(flight.truths)
        flight.order("reset {} {} {}".format(*reset_m))
        await flight.run(1.5)
        assert flight.flight.state is State.HOLDING
        moved_m, fastest_m_s = math.dist(flight.truths[-1][0], here), flight.top_speed_m_s(since)
        record(37, moved_m=round(moved_m, 3), fastest_m_s=round(fastest_m_s, 3))
        assert moved_m < 0.25 and fastest_m_s < 0.4
        heights_m = [p[2] for p, _ in flight.truths[since:]]
        assert max(heights_m) - min(heights_m) < 0.25


async def test_fault_37_a_bearing_that_is_being_computed_meanwhile_is_moved_along(start: Start) -> None:
    async with _flying(start()) as flight:
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        await flight.seconds_until(lambda: bool(flight.worker.waiting))
        late, flight.worker.waiting = flight.worker.waiting, []
        flight.order("reset 0 6 0")
        await flight.run(0.5)
        found: list[Iteration] = []
        flight.uav.sar.iterations.connect(found.append)
        for answer in late:
            flight.uav.sar.take_answer(answer)
        assert found and flight.state.p_local_enu_m is not None
        for one in found:
            assert one.p_local_enu_m is not None
            assert math.dist(one.p_local_enu_m, flight.state.p_local_enu_m) < 1.5


async def test_fault_38_a_clock_of_ours_that_stood_still_latches(start: Start) -> None:
    """The host was suspended for 5 s: no clock of ours has seen it, the vehicle's has."""
    async with _flying(start()) as flight:
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        flight.px4.link.clock._up_ns += 5 * NS_PER_S
        before = flight.report().setpoints
        after_s = await flight.seconds_until(lambda: flight.flight.state is State.LATCHED)
        await flight.run(3.0 - after_s)
        record(38, latched_after_s=after_s, set_points_after=flight.report().setpoints - before)
        assert flight.flight.state is State.LATCHED and flight.flight.status()["reason"] == "stalled"
        assert flight.report().setpoints - before <= 3
        assert flight.report().mode == "HOLD", "by its own failsafe"
        assert (await flight.engage()).startswith("the autopilot is in a failsafe (asked for "), (
            "until a person decides"
        )


async def test_fault_39_without_gps_silent_poses_land_it_while_it_still_knows_where_it_is(start: Start) -> None:
    async with _flying(start(gps=False)) as flight:
        assert await flight.engage() == ""
        await flight.until(State.APPROACHING)
        await flight.run(2.0)
        flight.has_poses = False
        after_s = await flight.seconds_until(lambda: flight.flight.state is State.LANDING)
        record(39, landing_after_s=after_s)
        assert after_s < 4.0
        assert flight.px4.commander.estimator.has_local_position
        await flight.until(State.IDLE, timeout_s=60.0)
        await flight.run(16.0)
        report = flight.report()
        assert not report.armed
        assert report.mode != "OFFBOARD"


async def test_fault_40_on_the_ground_in_offboard_it_says_what_to_do(start: Start) -> None:
    async with _flying(start()) as flight:
        flight.order("pilot offboard")
        after_s = await flight.seconds_until(lambda: bool(flight.flight.status()["not_ready"]))
        record(40, known_after_s=after_s)
        await flight.run(1.0)
        assert "the vehicle stands in mode offboard, in which it does not arm: choose Hold at the ground station" in (
            await flight.engage()
        )
        flight.order("pilot hold")
        await flight.run(1.0)
        assert await flight.engage() == ""


async def test_fault_40_outside_its_own_fence_it_is_not_engaged(start: Start) -> None:
    async with _flying(start()) as flight:
        flight.order("reset 0 0 -487")
        await flight.run(1.0)
        assert "the vehicle is outside gate.fence_*: East " in await flight.engage()


async def test_fault_49_poses_carry_the_vehicles_own_time_whatever_its_clock_does(start: Start) -> None:
    """Its clock began at nothing, and goes 1.5 % slower than ours: PX4 takes no stamp of another for its own."""
    flight = start(gps=False, clock_rate=0.985)
    async with _flying(flight):
        flight.is_heard = False  # nothing is measured while it stands there
        await flight.run(55.0)  # PX4 believes the stamps after 50 s
        flight.is_heard = True
        await flight.run(5.0)
        report = flight.report()
        assert flight.px4.link.companion_clock.has_converged and report.vision_dropped == 0
        assert report.vision_age_s is not None and abs(report.vision_age_s) < 0.05
        record(49, poses=report.vision, dropped=report.vision_dropped, age_ms=round(1000 * report.vision_age_s, 1))
        assert await flight.engage() == ""
