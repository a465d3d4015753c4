"""The preflight's list: each line alone, all lines together, and the parameter files that go with it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.messages import FlightMode
from companion.safety.preflight import (
    Heights,
    Readiness,
    ReadinessLimits,
    parameter_problems,
    readiness_problems,
    required_parameters,
)
from tests.paths import CONFIGS

_FILES = CONFIGS / "px4"
_LIMITS = ReadinessLimits(silent_s=2.0, min_battery=0.2, min_free_mib=500.0)
_READY = Readiness(
    observes=False,
    autopilot_problem="",
    heartbeat_age_s=0.5,
    has_position=True,
    estimator_age_s=0.3,
    estimator_healthy=True,
    failsafe=False,
    position_is_global=True,
    mode=FlightMode.HOLD,
    intended_mode=FlightMode.HOLD,
    timesync_age_s=0.1,
    battery=0.8,
    pose_problem="",
    north_problem="",
    datagram_age_s=0.1,
    packet_age_s=0.01,
    bad_signatures=0,
    clock_problem="",
    aoa_ready=True,
    recorder_failed=False,
    free_mib=9000.0,
)


def test_nothing_stands_against_a_vehicle_that_is_ready() -> None:
    assert readiness_problems(_READY, _LIMITS) == []
    told_less = replace(_READY, position_is_global=None, intended_mode=None)
    assert readiness_problems(told_less, _LIMITS) == [], "as an older log has it"
    assert readiness_problems(replace(_READY, can_arm=True), _LIMITS) == []
    assert readiness_problems(replace(_READY, can_arm=False, armed=True), _LIMITS) == [], "it is armed already"


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"observes": True}, "the service observes; mission.control: fly lets it be engaged"),
        ({"heartbeat_age_s": 2.1}, "no heartbeat of the autopilot"),
        ({"autopilot_problem": "port taken"}, "no heartbeat of the autopilot: port taken"),
        ({"has_position": False}, "the autopilot has no local position"),
        ({"has_heading": False}, "the autopilot tells no heading (ATTITUDE)"),
        ({"estimator_age_s": 3.1}, "the autopilot's estimator tells nothing of itself"),
        ({"estimator_healthy": False}, "the autopilot's estimator is not healthy"),
        (
            {"failsafe": True, "in_air": True, "intended_mode": FlightMode.OFFBOARD},
            "the autopilot is in a failsafe (asked for offboard, flies hold): choose Hold at the ground station",
        ),
        (
            {"in_air": True, "mode": FlightMode.MANUAL, "intended_mode": FlightMode.MANUAL},
            "the vehicle is flown in mode manual; put it into hold first",
        ),
        (
            {"in_air": True, "intended_mode": FlightMode.OFFBOARD},
            "the vehicle holds, but was asked for offboard and may go back to it: choose Hold at the ground station",
        ),
        (
            {"mode": FlightMode.OFFBOARD, "intended_mode": None},
            "the vehicle stands in mode offboard, in which it does not arm: choose Hold at the ground station",
        ),
        (
            {"mode": FlightMode.HOLD, "intended_mode": FlightMode.LAND},
            "the vehicle stands in mode land, in which it does not arm: choose Hold at the ground station",
        ),
        (
            {"position_is_global": False},
            "the autopilot has no global position, without which it cannot hold: with GPS wait for a fix; without, it "
            "is given an origin (autopilot.origin_deg) once it takes our poses",
        ),
        (
            {"outside_fence": "East 0.0, North 0.0, Up -487.0 m"},
            "the vehicle is outside gate.fence_*: East 0.0, North 0.0, Up -487.0 m",
        ),
        ({"can_arm": False}, "PX4's own arming checks fail: it has not said why"),
        (
            {"can_arm": False, "arming_reasons": ("estimator high accel bias", "accel missing")},
            "PX4's own arming checks fail: estimator high accel bias; accel missing",
        ),
        ({"not_px4": "ardupilot"}, "the vehicle is no PX4 but ardupilot"),
        ({"not_px4": "px4 on a fixed wing"}, "the vehicle is no multicopter but a fixed wing"),
        ({"are_two": True}, "two vehicles of one system id are on the link: give each its own MAV_SYS_ID"),
        ({"landed_unknown": True}, "the autopilot does not tell whether it is in the air (EXTENDED_SYS_STATE)"),
        ({"time_known": False}, "clocks: the vehicle's own time is not known yet, in which poses are stamped"),
        ({"battery": None}, "no battery tells how full it is (BATTERY_STATUS)"),
        ({"batteries_unknown": (1, 2)}, "battery 1, 2 is silent, or does not know how full it is"),
        ({"timesync_age_s": 3.1}, "clocks: the autopilot takes no part in TIMESYNC"),
        ({"battery": 0.19}, "the battery is low: 19 %, wanted 20"),
        ({"pose_problem": "poses are 1.0 s old"}, "no fresh poses: poses are 1.0 s old"),
        ({"north_problem": "North is not known"}, "North is not known"),
        ({"datagram_age_s": 2.1}, "no datagrams of the target"),
        (
            {"datagram_age_s": 2.1, "bad_signatures": 7},
            "no datagrams of the target (7 came with a wrong signature: compare the keys)",
        ),
        (
            {"datagram_age_s": 2.1, "old_boots": 3},
            "no datagrams of the target (3 came of a boot before one heard already: see the log)",
        ),
        ({"packet_age_s": 2.1}, "no packets of the target"),
        ({"clock_problem": "the clock of beacon is not related"}, "the clock of beacon is not related"),
        ({"packet_age_s": 2.1, "clock_problem": "no shared exchanges"}, "no packets of the target"),
        ({"aoa_ready": False}, "the AOA worker is not ready"),
        ({"recorder_failed": True}, "the recorder has stopped"),
        ({"free_mib": 499.0}, "the disk has 499 MiB left, wanted 500"),
    ],
)
def test_each_thing_that_is_missing_is_one_line(change: dict[str, object], problem: str) -> None:
    assert readiness_problems(replace(_READY, **change), _LIMITS) == [problem]  # type: ignore[arg-type]


def test_what_arming_checks_say_is_not_asked_of_a_vehicle_that_is_not_heard() -> None:
    unheard = replace(_READY, can_arm=False, heartbeat_age_s=9.0)
    assert readiness_problems(unheard, _LIMITS) == ["no heartbeat of the autopilot"]


def test_all_that_is_missing_is_told_at_once() -> None:
    bad = replace(_READY, observes=True, has_position=False, battery=0.1, aoa_ready=False, free_mib=1.0)
    assert len(readiness_problems(bad, _LIMITS)) == 5


def _values(name: str) -> dict[str, float | str]:
    rows = [line.split("\t") for line in (_FILES / name).read_text().splitlines() if not line.startswith("#")]
    assert all(len(row) == 5 and row[4] in ("6", "9") for row in rows)
    return {row[2]: float(row[3]) for row in rows}


@pytest.mark.parametrize(("name", "gps"), [("gps.params", True), ("gps-denied.params", False)])
def test_the_parameter_files_pass_the_preflight(name: str, gps: bool) -> None:
    told = {"NAV_MC_ALT_RAD": 0.8, "GF_MAX_VER_DIST": 0.0} | _values(name)
    assert list(parameter_problems(told, gps, Heights(takeoff_m=1.5, ceiling_m=5.0))) == []


_PX4_DEFAULTS: dict[str, float | str] = {
    "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0, "COM_RC_OVERRIDE": 1, "GF_ACTION": 2, "SYS_HAS_GPS": 1,
    "EKF2_EV_CTRL": 0, "EKF2_GPS_CTRL": 7, "EKF2_HGT_REF": 1, "RTL_RETURN_ALT": 30.0, "GF_MAX_VER_DIST": 0.0,
    "NAV_MC_ALT_RAD": 0.8, "EKF2_EV_DELAY": 0.0, "COM_TAKEOFF_ACT": 0,
}  # fmt: skip


def test_px4s_own_defaults_do_not_pass_and_each_line_says_value_wanted_and_why() -> None:
    assert list(parameter_problems(_PX4_DEFAULTS, gps=True)) == [
        "parameter COM_OBL_RC_ACT is 0; wanted 4 (land) or 5 (hold): what PX4 does when the stream is lost; its "
        "default 0 descends when there is no RC",
        "parameter COM_RC_OVERRIDE is 1; wanted 3: moving the sticks must give the pilot the vehicle in auto modes (1) "
        "and in OFFBOARD (2)",
    ]
    assert len(list(parameter_problems(_PX4_DEFAULTS, gps=False))) == 6


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("COM_OF_LOSS_T", (0.75, 1.0), (0.0, 0.3, 0.5, 0.7, 1.1, 5.0)),
        ("COM_OBL_RC_ACT", (4, 5), (0, 1, 2, 3, 6)),
        ("COM_RC_OVERRIDE", (3, 7), (0, 1, 2, 4)),
        ("GF_ACTION", (2, 3, 5), (0, 1, 4)),
        ("SYS_HAS_GPS", (1,), (0,)),
        ("EKF2_EV_CTRL", (0,), (1, 15)),
    ],
)
def test_which_values_pass(name: str, good: tuple[float, ...], bad: tuple[float, ...]) -> None:
    (requirement,) = (r for r in required_parameters(gps=True) if r.name == name)
    assert all(map(requirement.accepts, good)) and not any(map(requirement.accepts, bad))


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("SYS_HAS_GPS", (0,), (1, 2)),
        ("EKF2_EV_CTRL", (11, 15), (0, 3, 9, 10, 14)),
        ("EKF2_GPS_CTRL", (0,), (1, 7)),
        ("EKF2_HGT_REF", (3,), (0, 1, 2, 4)),
        ("EKF2_EV_DELAY", (0.0, 20.0, 100.0), (-1.0, 100.1, 175.0, 300.0)),
    ],
)
def test_which_values_pass_without_gps(name: str, good: tuple[float, ...], bad: tuple[float, ...]) -> None:
    (requirement,) = (r for r in required_parameters(gps=False) if r.name == name)
    assert all(map(requirement.accepts, good)) and not any(map(requirement.accepts, bad))


_GOOD: dict[str, float | str] = _PX4_DEFAULTS | {"COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3, "RTL_RETURN_ALT": 3.0}


@pytest.mark.parametrize(
    ("change", "heights", "named"),
    [
        ({}, Heights(1.5, 5.0), []),
        ({"RTL_RETURN_ALT": 30.0}, Heights(1.5, 5.0), ["RTL_RETURN_ALT"]),
        ({"RTL_RETURN_ALT": 4.8}, Heights(1.5, 5.0), ["RTL_RETURN_ALT"]),
        ({"RTL_RETURN_ALT": 4.0, "GF_MAX_VER_DIST": 4.0}, Heights(1.5, 9.0), ["RTL_RETURN_ALT"]),
        ({"RTL_RETURN_ALT": 1.0, "GF_MAX_VER_DIST": 1.6}, Heights(1.5, 9.0), ["GF_MAX_VER_DIST"]),
        ({"NAV_MC_ALT_RAD": 0.8}, Heights(1.0, 5.0), ["NAV_MC_ALT_RAD"]),
        ({"NAV_MC_ALT_RAD": 0.5}, Heights(1.0, 5.0), []),
        ({"GF_MAX_VER_DIST": "no answer"}, Heights(1.5, 5.0), ["no answer; wanted 0, or above RTL_RETURN_ALT"]),
    ],
)
def test_heights_of_parameters_leave_room_for_each_other(
    change: dict[str, float | str], heights: Heights, named: list[str]
) -> None:
    problems = list(parameter_problems(_GOOD | change, True, heights))
    assert len(problems) == len(named) and all(name in line for name, line in zip(named, problems, strict=True))


def test_a_parameter_that_cannot_be_read_is_named_with_what_is_wanted() -> None:
    problems = list(parameter_problems(_PX4_DEFAULTS | {"GF_ACTION": "parameter GF_ACTION: no answer"}, gps=True))
    assert "parameter GF_ACTION: no answer; wanted 2 (hold), 3 (return) or 5 (land): PX4's own geofence" in problems[-1]


@pytest.mark.parametrize(
    ("name", "gps", "good", "bad"),
    [
        ("COM_OF_LOSS_T", True, (0.75,), (-1.0, 0.74)),
        ("COM_RC_OVERRIDE", True, (3, 7, 11), (0, 1, 2, 4, 8)),
        ("RTL_RETURN_ALT", True, (0.1, 300.0), (0.0, -0.5, -2.0)),
        ("GF_MAX_VER_DIST", True, (0.0, 12.0), (-0.5, -1.0)),
        ("NAV_MC_ALT_RAD", True, (0.1, 3.0), (0.0, -0.5, -2.0)),
        ("COM_TAKEOFF_ACT", True, (0,), (-1, 1, 2)),
        ("SYS_HAS_GPS", True, (1,), (-1, 0, 2)),
        ("EKF2_EV_CTRL", True, (0,), (-1, 1, 15)),
        ("SYS_HAS_GPS", False, (0,), (-1, 1)),
        ("EKF2_EV_CTRL", False, (11, 15, 0x10B), (-1, 0, 1, 3, 7, 8, 9, 10, 14)),
        ("EKF2_GPS_CTRL", False, (0,), (-1, 1, 7)),
        ("EKF2_HGT_REF", False, (3,), (0, 1, 2, 4)),
    ],
)
def test_which_values_pass_and_which_are_next_to_them(
    name: str, gps: bool, good: tuple[float, ...], bad: tuple[float, ...]
) -> None:
    (requirement,) = (r for r in required_parameters(gps) if r.name == name)
    assert [value for value in good if not requirement.accepts(value)] == []
    assert [value for value in bad if requirement.accepts(value)] == []


@pytest.mark.parametrize(
    ("change", "heights", "named"),
    [
        ({"RTL_RETURN_ALT": 1.7}, Heights(1.5, 2.0), []),
        ({"RTL_RETURN_ALT": 1.71}, Heights(1.5, 2.0), ["RTL_RETURN_ALT"]),
        ({"GF_MAX_VER_DIST": 0.9, "NAV_MC_ALT_RAD": 0.1}, Heights(0.5, 9.0), ["RTL_RETURN_ALT"]),
        ({"GF_MAX_VER_DIST": -1.0}, Heights(1.5, 9.0), ["GF_MAX_VER_DIST"]),
        ({"RTL_RETURN_ALT": 0.1, "GF_MAX_VER_DIST": 0.5}, Heights(0.5, 9.0), ["GF_MAX_VER_DIST", "NAV_MC_ALT_RAD"]),
        ({"RTL_RETURN_ALT": 0.5, "GF_MAX_VER_DIST": 1.3}, Heights(1.0, 9.0), ["NAV_MC_ALT_RAD"]),
        ({"NAV_MC_ALT_RAD": 0.7}, Heights(1.0, 5.0), []),
        ({"NAV_MC_ALT_RAD": 9.0, "GF_MAX_VER_DIST": -1.0}, Heights(10.0, 12.0), ["GF_MAX_VER_DIST"]),
    ],
)
def test_a_height_at_its_limit_passes(change: dict[str, float], heights: Heights, named: list[str]) -> None:
    problems = list(parameter_problems(_GOOD | change, True, heights))
    assert [line.split()[1] for line in problems] == named


def test_a_name_that_sorts_after_a_height_is_no_height() -> None:
    """SYS_HAS_GPS, of the last in the list, is 1 however low the ceiling is."""
    problems = list(parameter_problems(_GOOD | {"RTL_RETURN_ALT": 0.5}, True, Heights(1.5, 0.8)))
    assert problems == []


def test_without_a_configuration_the_takeoff_is_at_1_5_m_and_the_ceiling_open() -> None:
    assert Heights() == Heights(takeoff_m=1.5, ceiling_m=float("inf"))


@pytest.mark.parametrize(
    "change",
    [
        {"heartbeat_age_s": 2.0},
        {"estimator_age_s": 3.0},
        {"timesync_age_s": 3.0},
        {"battery": 0.2},
        {"datagram_age_s": 2.0},
        {"packet_age_s": 2.0},
        {"free_mib": 500.0},
    ],
)
def test_a_limit_itself_passes(change: dict[str, float]) -> None:
    assert readiness_problems(replace(_READY, **change), _LIMITS) == []  # type: ignore[arg-type]


def test_an_estimator_that_tells_nothing_is_not_called_unhealthy_as_well() -> None:
    silent = replace(_READY, estimator_age_s=3.1, estimator_healthy=False)
    assert readiness_problems(silent, _LIMITS) == ["the autopilot's estimator tells nothing of itself"]
    told = replace(_READY, estimator_age_s=3.0, estimator_healthy=False)
    assert readiness_problems(told, _LIMITS) == ["the autopilot's estimator is not healthy"]


def test_a_clock_is_a_matter_of_its_own_as_long_as_packets_and_datagrams_come() -> None:
    at_limit = replace(_READY, datagram_age_s=2.0, packet_age_s=2.0, clock_problem="not related")
    assert readiness_problems(at_limit, _LIMITS) == ["not related"]


@pytest.mark.parametrize(("battery", "told"), [(0.0, "0 %"), (0.04, "4 %"), (0.55, "55 %")])
def test_a_low_battery_is_told_in_percent(battery: float, told: str) -> None:
    (problem,) = readiness_problems(replace(_READY, battery=battery), replace(_LIMITS, min_battery=0.6))
    assert problem == f"the battery is low: {told}, wanted 60"


@pytest.mark.parametrize("mode", [mode for mode in FlightMode if mode is not FlightMode.HOLD])
def test_in_the_air_only_hold_is_handed_over(mode: FlightMode) -> None:
    """Of all modes, whatever their names sort after."""
    flown = replace(_READY, in_air=True, mode=mode, intended_mode=mode)
    assert readiness_problems(flown, _LIMITS) == [f"the vehicle is flown in mode {mode}; put it into hold first"]
    asked = replace(_READY, in_air=True, intended_mode=mode)
    assert readiness_problems(asked, _LIMITS) == [
        f"the vehicle holds, but was asked for {mode} and may go back to it: choose Hold at the ground station"
    ]


def test_in_the_air_a_vehicle_in_hold_is_handed_over_and_one_whose_mode_is_not_known_is_not() -> None:
    in_air = replace(_READY, in_air=True)
    assert readiness_problems(in_air, _LIMITS) == []
    unknown = replace(in_air, mode=None, intended_mode=None)
    assert readiness_problems(unknown, _LIMITS) == ["the vehicle is flown in mode None; put it into hold first"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1e30])
@pytest.mark.parametrize("gps", [True, False])
def test_a_parameter_that_is_no_number_or_below_all_is_right_for_nothing(gps: bool, value: float) -> None:
    names = [requirement.name for requirement in required_parameters(gps)]
    assert len(list(parameter_problems(dict.fromkeys(names, value), gps))) == len(names)


@pytest.mark.parametrize(
    ("vehicle", "told", "line"),
    [
        ("copter", "px4 on a ground rover", "the vehicle is no multicopter but a ground rover; mission.vehicle: rover "
         "is for such a one"),
        ("rover", "px4", "the vehicle is no ground rover but a multicopter; mission.vehicle: copter is for such a one"),
        ("rover", "px4 on a boat", "the vehicle is no ground rover but a boat"),
        ("rover", "ardupilot on a ground rover", "the vehicle is no PX4 but ardupilot on a ground rover"),
    ],
)  # fmt: skip
def test_the_vehicle_is_the_one_of_the_configuration(vehicle: str, told: str, line: str) -> None:
    assert readiness_problems(replace(_READY, vehicle=vehicle, not_px4=told), _LIMITS) == [line]


def test_a_rover_is_armed_in_hold_alone() -> None:
    """In a pilot's mode arming would give the sticks the wheels."""
    rover = replace(_READY, vehicle="rover")
    assert readiness_problems(rover, _LIMITS) == []
    (line,) = readiness_problems(replace(rover, mode=FlightMode.MANUAL, intended_mode=FlightMode.MANUAL), _LIMITS)
    assert line == "the rover stands in mode manual, in which it would be armed: choose Hold at the ground station"
    assert readiness_problems(replace(_READY, mode=FlightMode.MANUAL, intended_mode=FlightMode.MANUAL), _LIMITS) == []


def test_a_rover_needs_no_parameter_of_a_takeoff_or_of_heights() -> None:
    copter, rover = ({one.name for one in required_parameters(True, vehicle)} for vehicle in ("copter", "rover"))
    assert copter - rover == {"RTL_RETURN_ALT", "GF_MAX_VER_DIST", "NAV_MC_ALT_RAD", "COM_TAKEOFF_ACT"}
    values = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5.0, "COM_RC_OVERRIDE": 3.0, "GF_ACTION": 2.0, "SYS_HAS_GPS": 1.0,
              "EKF2_EV_CTRL": 0.0}  # fmt: skip
    assert list(parameter_problems(values, True, vehicle="rover")) == []
