"""What the edge makes of MAVLink messages as the library decodes them."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import pytest

from companion.autopilot.telemetry import Telemetry, is_healthy, parameter_field
from companion.core.messages import FlightMode, Pose
from tests.unit.companion.autopilot.telemetry_bench import HEARTBEAT, POSITION, TelemetryBench


@pytest.fixture
def bench() -> TelemetryBench:
    return TelemetryBench()


def test_position_turns_from_ned_to_enu(bench: TelemetryBench) -> None:
    bench.take("LOCAL_POSITION_NED", POSITION)
    state = bench.telemetry.state()
    assert state.p_local_enu_m == (2.0, 1.0, 3.0)
    assert state.v_local_enu_m_s == (0.2, 0.1, 0.3)
    bench.take("ATTITUDE", {"yaw": math.radians(30), "time_boot_ms": 57_001})
    assert bench.telemetry.state().yaw_enu_rad == pytest.approx(math.radians(60))


def test_ages_are_those_of_arrival(bench: TelemetryBench) -> None:
    bench.take("HEARTBEAT", HEARTBEAT)
    bench.now_ns = 2000
    bench.take("CURRENT_MODE", {"custom_mode": 3 << 16})
    bench.now_ns = 9000
    state = bench.telemetry.state()
    assert (state.heartbeat_mono_ns, state.mode_mono_ns, state.t_mono_ns) == (1000, 2000, 9000)
    assert state.mode is FlightMode.MANUAL and state.armed and not state.failsafe


def test_failsafe_landed_state_and_battery(bench: TelemetryBench) -> None:
    bench.take("HEARTBEAT", HEARTBEAT | {"system_status": 5, "base_mode": 1})
    assert bench.telemetry.state().failsafe and not bench.telemetry.state().armed
    for landed_state, in_air in [(0, False), (1, False), (2, True), (3, True), (4, True)]:
        bench.take("EXTENDED_SYS_STATE", {"landed_state": landed_state})
        assert bench.telemetry.state().in_air is in_air
    bench.take("BATTERY_STATUS", {"id": 0, "battery_remaining": 42})
    assert bench.telemetry.state().battery_remaining == 0.42
    bench.take("BATTERY_STATUS", {"id": 0, "battery_remaining": -1})
    assert bench.telemetry.state().battery_remaining is None


def test_other_components_of_the_vehicle_are_not_the_autopilot(bench: TelemetryBench) -> None:
    for component in (0, 2, 100, 300):
        bench.take("HEARTBEAT", HEARTBEAT, component)
    assert bench.telemetry.state().heartbeat_mono_ns is None


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("LOCAL_POSITION_NED", POSITION | {"x": None}),
        ("LOCAL_POSITION_NED", POSITION | {"vz": "fast"}),
        ("LOCAL_POSITION_NED", {"x": 1.0}),
        ("LOCAL_POSITION_NED", [1, 2, 3]),
        ("ATTITUDE", {"yaw": math.inf}),
        ("HEARTBEAT", {"custom_mode": None}),
        ("NO_SUCH", {}),
    ],
)
def test_what_does_not_fit_is_counted_and_changes_nothing(bench: TelemetryBench, name: str, fields: object) -> None:
    bench.take("LOCAL_POSITION_NED", POSITION)
    before = bench.telemetry.state()
    bench.now_ns = 5000
    bench.take(name, fields)
    assert bench.telemetry.malformed == 1
    bench.now_ns = before.t_mono_ns
    assert bench.telemetry.state() == before
    bench.telemetry.take("HEARTBEAT", 1, "{ not JSON")
    assert bench.telemetry.malformed == 2


def test_parameters_in_both_types_and_answers_to_commands(bench: TelemetryBench) -> None:
    five = struct.unpack("<f", struct.pack("<i", 5))[0]
    bench.take("PARAM_VALUE", {"param_id": "COM_OBL_RC_ACT", "param_value": five, "param_type": 6})
    bench.take("PARAM_VALUE", {"param_id": "COM_OF_LOSS_T\0", "param_value": 1.5, "param_type": 9})
    bench.take("PARAM_VALUE", {"param_id": "NEGATIVE", "param_value": None, "param_type": 6})
    assert bench.telemetry.parameters == {"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 1.5, "NEGATIVE": None}
    bench.take("COMMAND_ACK", {"command": 176, "result": 0})
    bench.take("COMMAND_ACK", {"command": 176, "result": 1})
    assert bench.telemetry.acknowledgements == {176: 1}


@pytest.mark.parametrize(
    ("flags", "at_rest", "in_air"),
    [
        (1023, True, False),  # GPS, disarmed at rest
        (895, True, True),  # GPS
        (495, True, False),  # our poses, disarmed at rest
        (367, True, True),  # our poses
        (383, True, True),  # our poses, with an origin
        (229, False, False),  # no poses yet
        (111, False, False),  # no poses for 0.6 s
        (101, False, False),  # none for 5 s
        (895 | 2048, False, False),
    ],
)
def test_what_px4_says_of_its_estimator(flags: int, at_rest: bool, in_air: bool) -> None:
    assert (is_healthy(flags, in_air=False), is_healthy(flags, in_air=True)) == (at_rest, in_air)


def test_modes_intended_and_flown(bench: TelemetryBench) -> None:
    hold, offboard = {"custom_mode": 4 << 16 | 3 << 24}, {"intended_custom_mode": 6 << 16}
    none_intended: list[dict[str, int]] = [{"intended_custom_mode": 0}, {}]  # an older one does not tell it
    for none in none_intended:
        for fields, intended in ((offboard, FlightMode.OFFBOARD), (none, None)):
            bench.take("CURRENT_MODE", hold | fields)
            state = bench.telemetry.state()
            assert (state.mode, state.intended_mode) == (FlightMode.HOLD, intended)


def test_what_the_vehicle_is(bench: TelemetryBench) -> None:
    bench.take("HEARTBEAT", HEARTBEAT)
    bench.take("AUTOPILOT_VERSION", {"flight_sw_version": 0x011001FF})
    assert (bench.telemetry.state().autopilot, bench.telemetry.state().firmware) == ("px4", "1.16.1")
    bench.take("HEARTBEAT", HEARTBEAT | {"autopilot": 3})
    assert bench.telemetry.state().autopilot == "ardupilot"


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (2, "px4"), (13, "px4"), (14, "px4"), (15, "px4"), (29, "px4"), (43, "px4"), (1, "px4 on a fixed wing"),
        (10, "px4 on a ground rover"), (12, "px4 on a submarine"), (19, "px4 on a VTOL"), (25, "px4 on a VTOL"),
        (0, "px4 on a vehicle of MAV_TYPE 0"), (26, "px4 on a vehicle of MAV_TYPE 26"),
    ],
)  # fmt: skip
def test_what_else_px4_flies_is_named(bench: TelemetryBench, kind: int, said: str) -> None:
    bench.take("HEARTBEAT", HEARTBEAT | {"type": kind})
    assert bench.telemetry.state().autopilot == said


def test_whether_it_is_in_the_air_is_unknown_until_it_is_told(bench: TelemetryBench) -> None:
    assert bench.telemetry.state().landed_unknown
    for landed_state, unknown in [(1, False), (0, True), (2, False), (5, True), (3, False), (6, True), (4, False)]:
        bench.take("EXTENDED_SYS_STATE", {"landed_state": landed_state})
        assert bench.telemetry.state().landed_unknown is unknown


def test_fault_62_whether_it_flies_is_unknown_once_it_is_not_told_any_more(bench: TelemetryBench) -> None:
    bench.take("EXTENDED_SYS_STATE", {"landed_state": 1})
    bench.now_ns += 3_000_000_000
    bench.take("HEARTBEAT", HEARTBEAT)
    assert not bench.telemetry.state().landed_unknown
    bench.now_ns += 1
    assert bench.telemetry.state().landed_unknown, "heartbeats go on, and it may have been flown off since"
    bench.take("EXTENDED_SYS_STATE", {"landed_state": 2})
    assert (bench.telemetry.state().landed_unknown, bench.telemetry.state().in_air) == (False, True)


def test_fault_62_a_heading_grows_old_beside_positions_that_go_on(bench: TelemetryBench) -> None:
    bench.take("ATTITUDE", {"yaw": 0.0, "time_boot_ms": 57_000})
    bench.now_ns += 500_000_000
    bench.take("LOCAL_POSITION_NED", POSITION | {"time_boot_ms": 57_500})
    assert bench.telemetry.state().yaw_enu_rad == pytest.approx(math.pi / 2)
    bench.now_ns += 1
    assert bench.telemetry.state().yaw_enu_rad is None and bench.telemetry.state().p_local_enu_m is not None
    bench.take("ATTITUDE", {"yaw": 0.0, "time_boot_ms": 57_501})
    assert bench.telemetry.state().yaw_enu_rad == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("percent", "remaining"), [(0, 0.0), (1, 0.01), (100, 1.0), (101, None), (127, None), (-1, None), (-2, None)]
)
def test_an_empty_battery_is_known_to_be_empty_and_more_than_full_is_not_known(
    bench: TelemetryBench, percent: int, remaining: float | None
) -> None:
    bench.take("BATTERY_STATUS", {"id": 3, "battery_remaining": percent})
    assert bench.telemetry.state().battery_remaining == remaining
    assert bench.telemetry.state().batteries_unknown == (() if remaining is not None else (3,))


def test_what_it_says_is_kept_in_order_as_long_as_there_is_room(bench: TelemetryBench) -> None:
    bench.take("STATUSTEXT", {"severity": 3, "text": "Low battery\0\0"})
    bench.now_ns = 2000
    bench.take("EVENT", {"id": 77, "log_levels": 0x54})
    first, second = bench.telemetry.take_events()
    assert (first.t_mono_ns, first.severity, first.text) == (1000, 3, "Low battery")
    assert (second.t_mono_ns, second.severity, second.text) == (2000, 4, "event 77")
    bench.take("EVENT", {"id": 78, "log_levels": 0x77})
    assert [event.severity for event in bench.telemetry.take_events()] == [7]
    for number in range(250):
        bench.take("STATUSTEXT", {"severity": 6, "text": f"{number}"})
    kept = [event.text for event in bench.telemetry.take_events()]
    assert kept == [str(number) for number in range(150, 250)], "the oldest go"
    assert bench.telemetry.take_events() == []


def test_arming_checks_are_of_one_boot_and_need_no_arguments_of_an_event(bench: TelemetryBench) -> None:
    masks = {"onboard_control_sensors_present": 0, "onboard_control_sensors_enabled": 0}
    assert bench.telemetry.state().can_arm is False, "nothing is known"
    bench.take("SYS_STATUS", masks | {"onboard_control_sensors_health": 1 << 28})
    assert bench.telemetry.state().can_arm is True and bench.telemetry.state().arming_reasons == ()
    bench.take("SYS_STATUS", masks | {"onboard_control_sensors_health": 0})
    bench.take("STATUSTEXT", {"severity": 2, "text": "Preflight Fail: Compass missing\0"})
    assert bench.telemetry.state().can_arm is False
    assert bench.telemetry.state().arming_reasons == ("Compass missing",)
    bench.take("AUTOPILOT_VERSION", {"flight_sw_version": 1 << 24 | 13 << 16})
    assert bench.telemetry.state().can_arm is False, "it has told before"
    for number, modes in ((27825120, []), (20390844, [16, 0, 0, 0, 7]), (25005055, [0, 64, 0, 0, 7]), (18691879, [])):
        bench.take("EVENT", {"id": number, "log_levels": 0x33, "arguments": modes})
    bench.take("CURRENT_MODE", {"custom_mode": 4 << 16 | 3 << 24})
    assert bench.telemetry.state().arming_reasons == ("estimator high accel bias",), "of the mode it is in"
    bench.take("EVENT", {"id": 1, "log_levels": 0x33, "arguments": [256]})
    bench.take("EVENT", {"id": 1, "log_levels": 0x33, "arguments": "abc"})
    assert bench.telemetry.malformed == 2
    bench.take("ATTITUDE", {"yaw": 0.0, "time_boot_ms": 90_000})
    bench.take("ATTITUDE", {"yaw": 0.0, "time_boot_ms": 100})
    assert bench.telemetry.state().boots == 1
    assert bench.telemetry.state().arming_reasons == ("it tells nothing of them (SYS_STATUS)",)


def test_rc_channels_are_as_many_as_it_says_and_no_more_than_there_are(bench: TelemetryBench) -> None:
    channels = {f"chan{number}_raw": 1000 + number for number in range(1, 19)}
    for count, told in ((0, 0), (1, 1), (16, 16), (18, 18), (40, 18)):
        bench.now_ns += 1
        bench.take("RC_CHANNELS", channels | {"chancount": count})
        assert bench.telemetry.malformed == 0
        assert bench.telemetry.state().rc_us == tuple(1000 + number for number in range(1, told + 1))
        assert bench.telemetry.state().rc_mono_ns == bench.now_ns


@pytest.mark.parametrize(
    ("flags", "is_global"), [(16, True), (1023, True), (495, False), (15, False), (32, False), (0, False)]
)
def test_a_global_position_is_one_bit(bench: TelemetryBench, flags: int, is_global: bool) -> None:
    bench.take("ESTIMATOR_STATUS", {"flags": flags})
    assert bench.telemetry.state().position_is_global is is_global
    assert bench.telemetry.state().estimator_mono_ns == 1000


@pytest.mark.parametrize("missing", [1, 2, 4])
def test_each_thing_an_estimator_must_know(missing: int) -> None:
    assert is_healthy(895, in_air=True) and not is_healthy(895 - missing, in_air=True)


@pytest.mark.parametrize(
    ("flags", "healthy"),
    [
        (1 | 2 | 4 | 8 | 256, True),
        (1 | 2 | 4 | 16 | 512, True),
        (1 | 2 | 4 | 32 | 256, False),  # the height above ground alone
        (1 | 2 | 4 | 8, False),
        (1 | 2 | 4 | 256, False),
        (1 | 2 | 4 | 8 | 64 | 1024, False),
        (1 | 2 | 4 | 8 | 256 | 2048 | 128, False),
    ],
)
def test_a_position_that_something_measures(flags: int, healthy: bool) -> None:
    assert is_healthy(flags, in_air=True) is healthy


@pytest.mark.parametrize(("status", "failsafe"), [(3, False), (4, False), (5, True), (6, True), (8, True)])
def test_a_failsafe_is_a_state_of_its_own(bench: TelemetryBench, status: int, failsafe: bool) -> None:
    bench.take("HEARTBEAT", HEARTBEAT | {"system_status": status})
    assert bench.telemetry.state().failsafe is failsafe


@pytest.mark.parametrize(("base_mode", "armed"), [(128, True), (127, False), (256, False), (384, True), (0, False)])
def test_armed_is_one_bit(bench: TelemetryBench, base_mode: int, armed: bool) -> None:
    bench.take("HEARTBEAT", HEARTBEAT | {"base_mode": base_mode})
    assert bench.telemetry.state().armed is armed


def test_answers_are_counted(bench: TelemetryBench) -> None:
    for _ in range(3):
        bench.take("COMMAND_ACK", {"command": 511, "result": 0})
    assert bench.telemetry.acknowledged[511] == 3


@pytest.mark.parametrize("value", [0, 1, 257, 2**31 - 1, -(2**31), -7])
def test_an_integer_parameter_goes_and_comes_in_four_bytes(bench: TelemetryBench, value: int) -> None:
    field = parameter_field(value)
    if math.isnan(field):
        return  # the library cannot carry it: PARAM_VALUE is then null
    for kind in (6, 300):
        bench.take("PARAM_VALUE", {"param_id": "N", "param_value": field, "param_type": kind})
        assert bench.telemetry.parameters["N"] == value
    assert parameter_field(1.5) == 1.5


def test_its_own_odometry_is_handed_on_and_its_resets_are_noted(bench: TelemetryBench) -> None:
    poses: list[Pose] = []
    telemetry = Telemetry(lambda: bench.now_ns, on_odometry=poses.append)
    odometry = {
        "time_usec": 5_000_000, "frame_id": 1, "child_frame_id": 12, "x": 1.0, "y": 0.0, "z": 0.0,
        "q": [1.0, 0.0, 0.0, 0.0], "vx": 1.0, "vy": 0.0, "vz": 0.0, "reset_counter": 4,
    }  # fmt: skip
    telemetry.take("ODOMETRY", 1, json.dumps(odometry))
    # Half a second later at 1 m/s North: what is more than half a metre is the reset's.
    after = odometry | {"time_usec": 5_500_000, "x": 3.5, "reset_counter": 5}
    telemetry.take("ODOMETRY", 1, json.dumps(after))
    assert telemetry.malformed == 0 and len(poses) == 2 and poses[0].t_mono_ns == bench.now_ns
    assert poses[0].p_enu_m == pytest.approx((0.0, 1.0, 0.0))
    state = telemetry.state()
    assert state.resets == 1 and state.p_reset_enu_m == pytest.approx((0.0, 2.0, 0.0))


def test_a_fix_is_taken_where_somebody_wants_it() -> None:
    telemetry = Telemetry(lambda: 7, wants_gps=True)
    assert "GPS_RAW_INT" in telemetry.message_names
    place = {"fix_type": 3, "lat": 473977420, "lon": 85455940, "alt": 488000}
    telemetry.take("GPS_RAW_INT", 1, json.dumps(place | {"alt_ellipsoid": 535500, "h_acc": 800, "v_acc": 1250}))
    gps = telemetry.state().gps
    assert gps is not None
    assert gps.t_mono_ns == 7
    assert [gps.latitude_deg, gps.longitude_deg] == pytest.approx([47.397742, 8.545594])
    assert (gps.hae_m, gps.horizontal_m, gps.vertical_m) == (535.5, 0.8, 1.25)
    for fields in (place | {"alt_ellipsoid": 0, "h_acc": 0, "v_acc": 0}, place):
        telemetry.take("GPS_RAW_INT", 1, json.dumps(fields))
        gps = telemetry.state().gps
        assert gps is not None and gps.latitude_deg == pytest.approx(47.397742)
        assert (gps.hae_m, gps.horizontal_m, gps.vertical_m) == (None, None, None), "0, or not sent: not known"
    assert telemetry.malformed == 0


@pytest.mark.parametrize(("kind", "is_fix"), [(0, False), (2, False), (3, True), (4, True), (5, True), (6, True)])
def test_a_fix_is_one_in_three_dimensions_or_better(kind: int, is_fix: bool) -> None:
    """4 to 6: differential, RTK afloat and RTK fixed; one that is lost is not kept."""
    telemetry = Telemetry(lambda: 7, wants_gps=True)
    for fix_type in (3, kind):
        telemetry.take("GPS_RAW_INT", 1, json.dumps({"fix_type": fix_type, "lat": 473977420, "lon": 85455940}))
    assert (telemetry.state().gps is not None) is is_fix


def test_what_is_subscribed_to_is_what_is_understood(bench: TelemetryBench) -> None:
    names = bench.telemetry.message_names
    assert "HEARTBEAT" in names and len(set(names)) == len(names) == 16


def test_an_older_firmware_that_tells_nothing_of_its_checks_has_no_reasons_either(bench: TelemetryBench) -> None:
    masks = {f"onboard_control_sensors_{part}": 0 for part in ("present", "enabled", "health")}
    bench.take("AUTOPILOT_VERSION", {"flight_sw_version": 1 << 24 | 13 << 16})
    bench.take("SYS_STATUS", masks)
    assert bench.telemetry.state().can_arm is None and bench.telemetry.state().arming_reasons == ()
    assert not bench.telemetry.fails_silently(), "whether it can arm is not known"


def test_it_fails_silently_while_it_cannot_arm_and_has_not_said_why(bench: TelemetryBench) -> None:
    masks = {f"onboard_control_sensors_{part}": 0 for part in ("present", "enabled", "health")}
    text, disarmed = {"severity": 3, "text": "Preflight Fail: no"}, HEARTBEAT | {"base_mode": 1}
    told = [("SYS_STATUS", masks), ("HEARTBEAT", HEARTBEAT), ("HEARTBEAT", disarmed), ("STATUSTEXT", text)]
    for (name, fields), is_silent in zip(told, (True, False, True, False), strict=True):
        bench.take(name, fields)
        assert bench.telemetry.fails_silently() is is_silent, name


def test_the_modes_of_a_check_are_the_first_four_bytes_of_its_event(bench: TelemetryBench) -> None:
    masks = {f"onboard_control_sensors_{part}": 0 for part in ("present", "enabled", "health")}
    bench.take("SYS_STATUS", masks)
    for number, arguments in ((27825120, []), (20390844, [0, 0, 0, 128, 7]), (25005055, [0, 0, 0, 0, 255])):
        bench.take("EVENT", {"id": number, "log_levels": 0x33, "arguments": arguments})
    assert bench.telemetry.state().arming_reasons == ("estimator high accel bias",)


def test_a_vehicle_that_has_not_said_whether_it_flies_is_taken_to_stand(bench: TelemetryBench) -> None:
    bench.take("ESTIMATOR_STATUS", {"flags": 1023})
    assert bench.telemetry.state().estimator_healthy


@pytest.mark.parametrize(("kind", "healthy"), [(2, False), (10, True)])
def test_an_estimate_that_rests_in_the_air_is_lost_but_for_a_rover_that_stands(
    bench: TelemetryBench, kind: int, healthy: bool
) -> None:
    """PX4 says of an armed rover that it is in the air."""
    bench.take("HEARTBEAT", HEARTBEAT | {"type": kind})
    bench.take("EXTENDED_SYS_STATE", {"landed_state": 2})
    bench.take("ESTIMATOR_STATUS", {"flags": 1023})
    assert bench.telemetry.state().estimator_healthy is healthy


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("PARAM_VALUE", {"param_id": "X", "param_value": 1e308, "param_type": 6}),
        ("PARAM_VALUE", {"param_id": "X", "param_value": 10**40, "param_type": 6}),
        ("PARAM_VALUE", {"param_id": "X", "param_value": [], "param_type": 6}),
        ("ESTIMATOR_STATUS", {"flags": math.inf}),
        ("ATTITUDE", {"time_boot_ms": math.inf, "yaw": 0.0}),
        ("COMMAND_ACK", {"command": math.inf, "result": 0}),
        ("EVENT", {"id": 1, "log_levels": 1, "arguments": 10**40}),
        ("CURRENT_MODE", []),
        ("CURRENT_MODE", None),
    ],
)
def test_whatever_arrives_is_counted_and_nothing_raises(bench: TelemetryBench, name: str, fields: Any) -> None:
    before = bench.telemetry.state()
    bench.telemetry.take(name, 1, json.dumps(fields))
    assert bench.telemetry.malformed == 1
    assert bench.telemetry.state() == before
