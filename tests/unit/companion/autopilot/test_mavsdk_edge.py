"""The edge against the mock in virtual time: the vehicle's clock, its restarts, its resets, and the battery's age."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from companion.autopilot.port import AutopilotError, GaveWayError
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, Setpoint, Vector3
from companion.sim.px4.commander import Mode
from tests.unit.companion.autopilot.virtual_vehicle import VirtualVehicle

_GPS_DENIED = {"SYS_HAS_GPS": 0, "EKF2_GPS_CTRL": 0, "EKF2_EV_CTRL": 11, "EKF2_HGT_REF": 3, "COM_OBL_RC_ACT": 4}


@pytest.mark.parametrize(("clock_rate", "seconds"), [pytest.param(0.985, 600, marks=pytest.mark.long), (1.00001, 100)])
def test_vision_stays_accepted_for_ten_minutes_in_the_vehicles_own_time(clock_rate: float, seconds: float) -> None:
    """PX4 believes the stamps after 50 s: they must be of its own clock, whatever that does."""
    vehicle = VirtualVehicle(parameters=_GPS_DENIED, clock_rate=clock_rate)
    vehicle.run(1.0)
    vehicle.quiet()
    vehicle.poses = 0.03
    vehicle.run(seconds)
    report = vehicle.px4.report(vehicle.clock.now_ns())
    assert vehicle.px4.link.companion_clock.has_converged
    assert report.vision > 9 * seconds and report.vision_dropped == 0
    assert report.vision_age_s == pytest.approx(0.034, abs=0.015)
    assert vehicle.state().estimator_healthy


def test_poses_wait_until_the_vehicles_time_is_known() -> None:
    vehicle = VirtualVehicle(parameters=_GPS_DENIED)
    with pytest.raises(Exception, match="its own time is not known yet; ODOMETRY was not sent"):
        vehicle._send_pose(0.0)
    vehicle.run(0.3)
    vehicle._send_pose(0.0)
    offset_ns = vehicle.state().clock_offset_ns
    assert offset_ns is not None
    own_ns = vehicle.px4.link.clock.ns(vehicle.clock.now_ns())
    assert vehicle.clock.now_ns() + offset_ns == pytest.approx(own_ns, abs=5_000_000)


def test_estimator_is_healthy_at_rest_and_in_the_air_with_gps_and_without() -> None:
    for parameters in ({}, _GPS_DENIED):
        vehicle = VirtualVehicle(parameters=parameters)
        vehicle.run(1.0)
        vehicle.poses = 0.02
        vehicle.run(2.0)
        assert vehicle.state().estimator_healthy and not vehicle.state().in_air
        vehicle.px4.commander.command_mode(Mode.TAKEOFF, vehicle.clock.now_ns())
        vehicle.px4.commander.arm(vehicle.clock.now_ns())
        vehicle.run(4.0)
        assert vehicle.state().estimator_healthy and vehicle.state().in_air
        vehicle.poses = None
        vehicle.run(1.6)
        assert vehicle.state().estimator_healthy is (not parameters), "nothing measures where it is"


def test_a_restarted_vehicle_is_asked_again_at_once_and_its_old_state_is_forgotten() -> None:
    vehicle = VirtualVehicle()
    vehicle.px4.order("battery 1 0.05")
    vehicle.run(20.0)
    before = vehicle.state()
    assert before.battery_remaining == 0.05
    vehicle.px4.order("battery 1 silent")
    assert before.firmware == "1.16.1" and before.autopilot == "px4" and before.system_id == 1 and before.boots == 0
    vehicle.px4.order("reboot 3")
    vehicle.run(3.0)
    restarted = vehicle.state()
    assert restarted.boots == 1 and restarted.battery_remaining == 0.95 and restarted.batteries_unknown == ()
    assert restarted.boot_ms is not None and restarted.boot_ms < 200
    assert restarted.heartbeat_mono_ns is not None, "it is heard all the same"
    vehicle.run(0.3)
    after = vehicle.px4.link.received
    assert after["COMMAND_LONG 511"] == 2 * 9, "each interval once more"
    periods_ns = vehicle.px4.link.streams._period_ns
    assert periods_ns["LOCAL_POSITION_NED"] == periods_ns["CURRENT_MODE"] == NS_PER_S // 20
    vehicle.run(2.0)
    assert vehicle.state().firmware == "1.16.1" and vehicle.state().mode is FlightMode.HOLD
    told = [event.text for event in vehicle.edge.take_events()]
    told = [text for text in told if not text.startswith("event ")]  # reports of its arming checks
    assert told == ["the autopilot has restarted: its clock is at 0.0 s again"]
    offset_ns = vehicle.state().clock_offset_ns
    assert offset_ns is not None
    own_ns = vehicle.px4.link.clock.ns(vehicle.clock.now_ns())
    assert vehicle.clock.now_ns() + offset_ns == pytest.approx(own_ns, abs=5_000_000)


def test_a_vehicle_tells_its_place_oftener_while_it_is_armed() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(2.0)
    periods_ns = vehicle.px4.link.streams._period_ns
    assert periods_ns["LOCAL_POSITION_NED"] == NS_PER_S // 20
    vehicle.px4.commander.arm(vehicle.clock.now_ns())
    vehicle.run(1.3)  # HEARTBEAT tells it once a second
    assert vehicle.state().armed and periods_ns["LOCAL_POSITION_NED"] == NS_PER_S // 50
    vehicle.px4.commander.disarm()
    vehicle.run(1.3)
    assert not vehicle.state().armed and periods_ns["LOCAL_POSITION_NED"] == NS_PER_S // 20


def test_intervals_that_were_lost_on_the_way_are_asked_for_again() -> None:
    vehicle = VirtualVehicle()
    vehicle.px4.link.vanish()
    vehicle.run(2.5)
    vehicle.px4.link._off_until_ns = 0
    vehicle.run(2.0)
    assert vehicle.px4.link.streams._period_ns["CURRENT_MODE"] == NS_PER_S // 20
    asked = vehicle.px4.link.received["COMMAND_LONG 511"]
    vehicle.run(5.0)
    assert vehicle.px4.link.received["COMMAND_LONG 511"] == asked, "answered: not again"


def test_a_pause_of_our_clock_shows_in_the_vehicles() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(5.0)
    assert vehicle.state().stood_still_ns == 0
    vehicle.px4.link.clock._up_ns += 5 * NS_PER_S  # the host was suspended: its monotonic clock stood, PX4's did not
    vehicle.run(0.3)
    state = vehicle.state()
    assert state.stood_still_ns == pytest.approx(5 * NS_PER_S, abs=NS_PER_S // 5) and state.boots == 0
    assert any("our clock stood still" in event.text for event in vehicle.edge.take_events())
    own_ns = vehicle.px4.link.clock.ns(vehicle.clock.now_ns())
    assert vehicle.clock.now_ns() + (state.clock_offset_ns or 0) == pytest.approx(own_ns, abs=5_000_000)


def test_announced_resets_become_an_offset_and_unannounced_motion_does_not() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(2.0)
    vehicle.px4.order("reset 5 -1 0.5")
    vehicle.run(0.2)
    vehicle.px4.order("reset -2 0 0")
    vehicle.run(0.2)
    state = vehicle.state()
    assert state.resets == 2 and state.p_reset_enu_m == pytest.approx((3.0, -1.0, 0.5), abs=0.01)
    assert state.p_local_enu_m == pytest.approx((3.0, -1.0, 0.5), abs=0.1)


def test_batteries_by_their_ids_and_ages() -> None:
    vehicle = VirtualVehicle()
    vehicle.px4.order("battery 0 0.05")
    vehicle.px4.order("battery 1 0.95")
    vehicle.run(2.5)
    assert vehicle.state().battery_remaining == 0.05 and vehicle.state().batteries_unknown == ()
    vehicle.px4.order("battery 0 unknown")
    vehicle.run(2.5)
    assert vehicle.state().battery_remaining == 0.05 and vehicle.state().batteries_unknown == (0,)
    vehicle.px4.order("battery 0 silent")
    vehicle.px4.order("battery 1 silent")
    told_ns = vehicle.state().battery_mono_ns
    vehicle.run(6.0)
    state = vehicle.state()
    assert state.battery_remaining is None and state.batteries_unknown == (0, 1) and state.battery_mono_ns is not None
    assert told_ns is not None and state.battery_mono_ns <= told_ns + NS_PER_S


def test_its_own_arming_checks_and_why_they_fail() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(3.0)
    assert vehicle.state().can_arm is True and vehicle.state().arming_reasons == ()
    vehicle.px4.order("checks fail high_accel_bias usb_connected")
    vehicle.run(1.0)
    assert vehicle.state().can_arm is False
    assert vehicle.state().arming_reasons == ("estimator high accel bias", "system usb connected")
    assert "COMMAND_LONG 401" not in vehicle.px4.link.received, "it has said why by itself"
    vehicle.px4.order("checks pass")
    vehicle.run(1.0)
    assert vehicle.state().can_arm is True and vehicle.state().arming_reasons == ()


def test_who_listens_late_asks_why_they_fail_until_it_is_said() -> None:
    vehicle = VirtualVehicle()
    vehicle.px4.order("checks fail accel_missing")
    for _ in range(300):  # it has said so while nobody listened
        vehicle.clock.advance(0.01)
        vehicle.px4.step(vehicle.clock.now_ns())
    vehicle.run(4.5)
    assert vehicle.state().arming_reasons == ("accel missing",)
    assert vehicle.px4.link.received["COMMAND_LONG 401"] == 1
    vehicle.px4.order("checks pass")
    vehicle.run(3.0)
    assert vehicle.state().can_arm and vehicle.px4.link.received["COMMAND_LONG 401"] == 1


def test_an_armed_vehicle_is_not_asked_about_its_checks() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(3.0)
    vehicle.px4.commander.arm(vehicle.clock.now_ns())
    vehicle.px4.order("checks fail accel_missing")
    vehicle.px4.link.streams._period_ns["SYS_STATUS"] = -1
    vehicle.run(5.0)
    assert vehicle.state().can_arm is False and vehicle.state().armed
    assert vehicle.state().arming_reasons == ("it tells nothing of them (SYS_STATUS)",)
    assert "COMMAND_LONG 401" not in vehicle.px4.link.received


def test_an_origin_gives_a_vehicle_without_gps_its_global_position() -> None:
    vehicle = VirtualVehicle(parameters=_GPS_DENIED)
    vehicle.run(1.0)
    vehicle.poses = 0.02
    vehicle.run(1.0)
    assert not vehicle.px4.commander.estimator.has_global_position
    vehicle.edge.set_origin(47.4, 8.5)
    vehicle.run(0.1)
    assert vehicle.px4.commander.estimator.has_global_position
    assert vehicle.px4.commander.estimator.origin_altitude_m == 0.0


def test_a_mode_is_asked_for_again_when_it_was_refused_and_not_when_it_was_granted() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(2.0)
    for refuses, times in ((True, 2), (False, 1)):
        vehicle.px4.commander.refuse_offboard = refuses
        before, ask = vehicle.px4.link.received.get("COMMAND_LONG 176", 0), vehicle.edge._asker(176, (1, 6, 0))
        ask()
        vehicle.run(0.2)
        ask()
        vehicle.run(0.2)
        assert vehicle.px4.link.received["COMMAND_LONG 176"] - before == times


def test_a_mode_is_not_asked_for_again_while_nothing_is_heard_of_it() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(2.0)
    vehicle.px4.commander.refuse_offboard = True
    before, ask = vehicle.sent.count("COMMAND_LONG"), vehicle.edge._asker(176, (1, 6, 0))
    ask()
    ask()
    assert vehicle.sent.count("COMMAND_LONG") - before == 1
    vehicle.run(0.2)
    ask()
    assert vehicle.sent.count("COMMAND_LONG") - before == 2


@pytest.fixture
def vehicle(monkeypatch: pytest.MonkeyPatch) -> VirtualVehicle:
    """Whoever sleeps lets the vehicle's time pass."""
    one = VirtualVehicle(parameters={"MIS_TAKEOFF_ALT": 2.5})
    one.run(1.0)

    async def sleep(seconds: float) -> None:
        one.run(seconds)

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", sleep)
    return one


async def test_it_arms_takes_off_flies_holds_returns_and_lands(vehicle: VirtualVehicle) -> None:
    edge = vehicle.edge
    await edge.arm()
    assert edge.state().armed
    await edge.takeoff(1.5)
    up_m = (edge.state().p_local_enu_m or (0.0, 0.0, 0.0))[2]
    assert edge.state().in_air and up_m == pytest.approx(1.5, abs=0.3) and edge.state().mode is FlightMode.HOLD
    sent = len(vehicle.sent)
    await edge.takeoff(1.5)
    assert len(vehicle.sent) == sent, "it flies already"
    for _ in range(20):
        edge.send_setpoint(Setpoint(vehicle.clock.now_ns(), (0.0, 0.0, up_m), (0.0, 0.0, 0.0), 0.0))
        vehicle.run(0.05)
    await edge.request_offboard()
    assert edge.state().mode is FlightMode.OFFBOARD
    await edge.return_home()
    assert edge.state().mode is FlightMode.RETURN
    await edge.hold()
    assert edge.state().mode is FlightMode.HOLD
    await edge.land()
    assert edge.state().mode is FlightMode.LAND


async def test_a_takeoff_gives_way_while_px4_reads(vehicle: VirtualVehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    await vehicle.edge.arm()
    asked, slept_s = vehicle.sent.count("COMMAND_LONG"), [0.0]

    async def sleep(seconds: float) -> None:
        vehicle.run(seconds)
        slept_s.append(seconds if "PARAM_SET" in vehicle.sent else 0.0)
        if sum(slept_s) > 1.0:
            vehicle.px4.order("pilot MANUAL")

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", sleep)
    with pytest.raises(GaveWayError, match="takeoff: manual and armed True meanwhile; somebody else decided"):
        await vehicle.edge.takeoff(1.5)
    assert vehicle.sent.count("COMMAND_LONG") == asked, "the vehicle is never asked to climb"


async def test_a_command_is_repeated_each_half_second_and_given_up_after_2_9_s(vehicle: VirtualVehicle) -> None:
    began_s = vehicle.clock.now_ns() / NS_PER_S
    asked = vehicle.sent.count("COMMAND_LONG")
    vehicle.px4.order("offboard refuse")
    with pytest.raises(
        AutopilotError, match=r"mode offboard: not confirmed by telemetry; mode is hold, .* was temporarily rejected"
    ):
        await vehicle.edge.request_offboard()
    assert vehicle.clock.now_ns() / NS_PER_S - began_s == pytest.approx(2.9, abs=0.05)
    assert vehicle.sent.count("COMMAND_LONG") - asked == 6


async def test_a_mode_that_somebody_else_chose_is_given_way_to(vehicle: VirtualVehicle) -> None:
    vehicle.px4.order("offboard refuse")
    asked = asyncio.ensure_future(vehicle.edge.request_offboard())
    vehicle.px4.order("pilot MANUAL")
    with pytest.raises(GaveWayError, match="mode offboard: the mode became manual meanwhile; somebody else decided"):
        await asked


async def test_parameters_are_read_written_and_named_when_they_are_not_there(vehicle: VirtualVehicle) -> None:
    edge = vehicle.edge
    assert await edge.parameter("MIS_TAKEOFF_ALT") == 2.5
    await edge.set_parameter("MIS_TAKEOFF_ALT", 3.5)
    assert await edge.parameter("MIS_TAKEOFF_ALT") == 3.5
    await edge.set_parameter("COM_OBL_RC_ACT", 4)
    assert await edge.parameter("COM_OBL_RC_ACT") == 4
    with pytest.raises(AutopilotError, match=r"parameter NO_SUCH: no answer; .* \(waited 2.9 s\)"):
        await edge.parameter("NO_SUCH")


async def test_a_program_that_stood_still_gives_up_what_it_had_asked_for(
    vehicle: VirtualVehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def stand_still(seconds: float) -> None:
        vehicle.clock.advance(0.6)

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", stand_still)
    vehicle.px4.order("offboard refuse")
    with pytest.raises(GaveWayError, match="given up because this program stood still"):
        await vehicle.edge.request_offboard()


@pytest.mark.parametrize(
    ("p_m", "yaw_rad", "mask"),
    [((1.0, 2.0, 3.0), 0.0, 2496), (None, 0.0, 2503), ((1.0, 2.0, 3.0), None, 3520), (None, None, 3527)],
)
def test_a_set_point_says_what_of_it_is_meant(p_m: Vector3 | None, yaw_rad: float | None, mask: int) -> None:
    vehicle = VirtualVehicle()
    told: dict[str, Any] = {}
    vehicle.send = lambda name, **fields: told.update(fields, name=name)  # type: ignore[method-assign]
    vehicle.edge.send_setpoint(Setpoint(0x1_0000_0000 * 1_000_000 + 5_000_000, p_m, (0.1, 0.2, 0.3), yaw_rad))
    assert told["type_mask"] == mask and told["name"] == "SET_POSITION_TARGET_LOCAL_NED"
    assert told["time_boot_ms"] == 5 and told["coordinate_frame"] == 1
    assert (told["vx"], told["vy"], told["vz"]) == (0.2, 0.1, -0.3)
    assert (told["x"], told["y"], told["z"]) == ((2.0, 1.0, -3.0) if p_m else (0.0, 0.0, 0.0))
    assert told["yaw"] == (0.0 if yaw_rad is None else pytest.approx(math.pi / 2)) and told["yaw_rate"] == 0.0
    assert (told["afx"], told["afy"], told["afz"]) == (0.0, 0.0, 0.0)
    with pytest.raises(AutopilotError, match="not finite; nothing was sent"):
        vehicle.edge.send_setpoint(Setpoint(0, (math.nan, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0))


def test_an_origin_is_sent_in_tenths_of_micro_degrees_and_at_altitude_0() -> None:
    vehicle = VirtualVehicle()
    told: dict[str, Any] = {}
    vehicle.send = lambda name, **fields: told.update(fields, name=name)  # type: ignore[method-assign]
    vehicle.edge.set_origin(47.25, -8.5)
    assert told == {
        "name": "SET_GPS_GLOBAL_ORIGIN", "target_system": 1, "latitude": 472_500_000, "longitude": -85_000_000,
        "altitude": 0, "time_usec": 0,
    }  # fmt: skip


async def test_it_lands_where_hold_is_refused(vehicle: VirtualVehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    """Out of OFFBOARD by way of hold, which needs a position that landing does not."""
    edge, commander = vehicle.edge, vehicle.px4.commander
    await edge.arm()
    await edge.takeoff(1.5)
    up_m = (edge.state().p_local_enu_m or (0.0, 0.0, 0.0))[2]

    def stream(seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            edge.send_setpoint(Setpoint(vehicle.clock.now_ns(), (0.0, 0.0, up_m), (0.0, 0.0, 0.0), 0.0))
            vehicle.run(0.05)

    stream(1.0)
    await edge.request_offboard()
    can_run = commander._can_run
    monkeypatch.setattr(commander, "_can_run", lambda mode: mode is not Mode.HOLD and can_run(mode))

    async def sleep(seconds: float) -> None:
        stream(max(seconds, 0.05))

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", sleep)
    await edge.land()
    assert edge.state().mode is FlightMode.LAND and vehicle.px4.link.received["COMMAND_LONG 176"] >= 3


def test_what_is_asked_for_at_the_beginning() -> None:
    vehicle = VirtualVehicle()
    vehicle.run(0.5)
    received, periods_ns = vehicle.px4.link.received, vehicle.px4.link.streams._period_ns
    assert received["COMMAND_LONG 511"] == 9 and received["COMMAND_LONG 512"] == 3, (
        "a late heartbeat, and both at the beginning"
    )
    wanted_hz = {
        "LOCAL_POSITION_NED": 20, "ATTITUDE": 20, "CURRENT_MODE": 20, "EXTENDED_SYS_STATE": 5, "BATTERY_STATUS": 1,
        "SYS_STATUS": 2, "ESTIMATOR_STATUS": 2, "RC_CHANNELS": 5, "ODOMETRY": 20,
    }  # fmt: skip
    assert {name: NS_PER_S / periods_ns[name] for name in wanted_hz} == wanted_hz
