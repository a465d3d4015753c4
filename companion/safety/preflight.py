"""What must be so before the vehicle is engaged: PX4's parameters and the state of every part. Pure.

Each entry says what is wrong, what is wanted and why, so that a person can act on the whole list at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from companion.core.messages import FlightMode

_ROOM_M: Final = 0.3
"""Between two heights: a climb overshoots, and the estimate's Up wanders."""
_MOST_DELAY_MS: Final = 100.0
"""From when a pose was true to its stamp: exposure and USB of a camera, or a motion capture's own time."""
_VISION_BITS: Final = 1 | 2 | 8
"""EKF2_EV_CTRL: horizontal position, vertical position, yaw."""


class Needed(StrEnum):
    """When a parameter matters."""

    ALWAYS = "always"
    COPTER = "a multicopter"
    GPS = "with GPS"
    VISION = "without GPS"


@dataclass(frozen=True, slots=True, kw_only=True)
class Requirement:
    """One parameter of PX4, as docs.px4.io describes it, and the values with which the safety case holds."""

    name: str
    needed: Needed
    accepts: Callable[[float], bool]
    wanted: str
    why: str

    def problem(self, value: float) -> str:
        return f"parameter {self.name} is {value:g}; wanted {self.wanted}: {self.why}"


REQUIREMENTS: Final = (
    Requirement(
        name="COM_OF_LOSS_T", needed=Needed.ALWAYS, accepts=lambda v: 0.75 <= v <= 1.0, wanted="0.75 to 1 s",
        why="so long PX4 flies on after the last set point; sooner it would act before we know that we stood still",
    ),
    Requirement(
        name="COM_OBL_RC_ACT", needed=Needed.ALWAYS, accepts=lambda v: v in (4, 5), wanted="4 (land) or 5 (hold)",
        why="what PX4 does when the stream is lost; its default 0 descends when there is no RC",
    ),
    Requirement(
        name="COM_RC_OVERRIDE", needed=Needed.ALWAYS, accepts=lambda v: int(v) & 3 == 3, wanted="3",
        why="moving the sticks must give the pilot the vehicle in auto modes (1) and in OFFBOARD (2)",
    ),
    Requirement(
        name="GF_ACTION", needed=Needed.ALWAYS, accepts=lambda v: v in (2, 3, 5),
        wanted="2 (hold), 3 (return) or 5 (land)",
        why="PX4's own geofence is the barrier behind ours; 0 and 1 do nothing, 4 stops the motors",
    ),
    Requirement(
        name="RTL_RETURN_ALT", needed=Needed.COPTER, accepts=lambda v: v > 0,
        wanted="below gate.fence_max_m and GF_MAX_VER_DIST",
        why="every return climbs to it, ours and those of PX4's failsafes: its default of 30 m leads through a ceiling",
    ),
    Requirement(
        name="GF_MAX_VER_DIST", needed=Needed.COPTER, accepts=lambda v: v >= 0, wanted="0, or above RTL_RETURN_ALT",
        why="a return that meets PX4's own fence ends in a failsafe up there",
    ),
    Requirement(
        name="NAV_MC_ALT_RAD", needed=Needed.COPTER, accepts=lambda v: v > 0,
        wanted="below mission.takeoff_height_m by 0.3 m",
        why="PX4 ends its takeoff so far from the height: one that is lower ends on the ground",
    ),
    Requirement(
        name="COM_TAKEOFF_ACT", needed=Needed.COPTER, accepts=lambda v: v == 0, wanted="0 (hold)",
        why="after a takeoff 1 flies the mission that is stored in PX4",
    ),
    Requirement(
        name="SYS_HAS_GPS", needed=Needed.GPS, accepts=lambda v: v == 1, wanted="1",
        why="autopilot.gps says that the position comes from GPS",
    ),
    Requirement(
        name="EKF2_EV_CTRL", needed=Needed.GPS, accepts=lambda v: v == 0, wanted="0",
        why="with GPS our poses are not for the estimator: two positions would pull at each other",
    ),
    Requirement(
        name="SYS_HAS_GPS", needed=Needed.VISION, accepts=lambda v: v == 0, wanted="0",
        why="without GPS PX4 must not wait for it before arming",
    ),
    Requirement(
        name="EKF2_EV_CTRL", needed=Needed.VISION, accepts=lambda v: v > 0 and int(v) & _VISION_BITS == _VISION_BITS,
        wanted="11 or 15",
        why="position, height and yaw come from our poses (bits 1, 2 and 8; 4 adds velocity)",
    ),
    Requirement(
        name="EKF2_GPS_CTRL", needed=Needed.VISION, accepts=lambda v: v == 0, wanted="0",
        why="a GPS fix through a window would pull the estimate away from the poses",
    ),
    Requirement(
        name="EKF2_HGT_REF", needed=Needed.VISION, accepts=lambda v: v == 3, wanted="3 (vision)",
        why="the height that is flown at is that of the poses",
    ),
    Requirement(
        name="EKF2_EV_DELAY", needed=Needed.VISION, accepts=lambda v: 0 <= v <= _MOST_DELAY_MS,
        wanted="0 to 100 ms, of the camera alone",
        why="our poses carry the vehicle's own time: delays for poses stamped on arrival count the way to it twice",
    ),
)  # fmt: skip
"""docs/vehicle.md has this table, generated."""

RETURN: Final = ("RTL_RETURN_ALT", "GF_MAX_VER_DIST")
"""What says how high a return climbs."""

EXPECTED: Final = {"copter": "px4", "rover": "px4 on a ground rover"}
"""What the vehicle must say it is, by `mission.vehicle`."""


def required_parameters(gps: bool, vehicle: str = "copter") -> tuple[Requirement, ...]:
    """Those that matter for a vehicle with GPS, or for one without. `vehicle` as in `mission.vehicle`."""
    needed = {Needed.ALWAYS, Needed.GPS if gps else Needed.VISION} | ({Needed.COPTER} if vehicle == "copter" else set())
    return tuple(requirement for requirement in REQUIREMENTS if requirement.needed in needed)


@dataclass(frozen=True, slots=True)
class Heights:
    """Of the configuration, above where the vehicle stands [m]: what parameters must leave room for."""

    takeoff_m: float = 1.5
    ceiling_m: float = math.inf


def parameter_problems(
    values: Mapping[str, float | str], gps: bool, heights: Heights = Heights(), vehicle: str = "copter"
) -> Iterator[str]:
    """One line for each wrong one of `values`, which has a number for each required name, or why it was not read."""
    yield from _problems(required_parameters(gps, vehicle), values, heights)


def return_problems(values: Mapping[str, float | str], heights: Heights) -> Iterator[str]:
    """The same of those that a way home climbs by, `RETURN`: somebody may have set them since the preflight."""
    yield from _problems((one for one in REQUIREMENTS if one.name in RETURN), values, heights)


def _problems(
    requirements: Iterable[Requirement], values: Mapping[str, float | str], heights: Heights
) -> Iterator[str]:
    for requirement in requirements:
        value = values[requirement.name]
        if isinstance(value, str):
            yield f"{value}; wanted {requirement.wanted}: {requirement.why}"
        elif not _is_met(requirement, value) or _has_no_room(requirement.name, value, values, heights):
            yield requirement.problem(value)


def _is_met(requirement: Requirement, value: float) -> bool:
    return math.isfinite(value) and requirement.accepts(value)


def _has_no_room(name: str, value: float, values: Mapping[str, float | str], heights: Heights) -> bool:
    """A height that is right by itself and wrong beside another one."""
    if name == "RTL_RETURN_ALT":
        fence_m = values["GF_MAX_VER_DIST"]
        lowest_m = min(heights.ceiling_m, fence_m if isinstance(fence_m, (int, float)) and fence_m > 0 else math.inf)
        return value > lowest_m - _ROOM_M
    if name == "GF_MAX_VER_DIST":
        return 0 < value < heights.takeoff_m + _ROOM_M
    return name == "NAV_MC_ALT_RAD" and value > heights.takeoff_m - _ROOM_M


@dataclass(frozen=True, slots=True, kw_only=True)
class Readiness:
    """What the service knows of itself now. Ages in seconds, infinite for what was never there."""

    observes: bool
    autopilot_problem: str
    heartbeat_age_s: float
    has_position: bool
    has_heading: bool = True
    estimator_age_s: float
    estimator_healthy: bool
    position_is_global: bool | None = None
    outside_fence: str = ""
    """Where the vehicle is, in words, if that is outside the gate's own fence."""
    failsafe: bool
    mode: FlightMode | None = None
    intended_mode: FlightMode | None = None
    in_air: bool = False
    landed_unknown: bool = False
    are_two: bool = False
    armed: bool = False
    can_arm: bool | None = None
    """The vehicle's own word on it, for the mode it is in; None where its firmware never tells."""
    arming_reasons: tuple[str, ...] = ()
    vehicle: str = "copter"
    """As in `mission.vehicle`."""
    not_px4: str = ""
    """What the vehicle says it is, where that is no PX4 on such a vehicle."""
    timesync_age_s: float
    time_known: bool = True
    """The vehicle's own time is known, or no poses are to be stamped in it."""
    battery: float | None
    batteries_unknown: tuple[int, ...] = ()
    pose_problem: str
    north_problem: str
    datagram_age_s: float
    packet_age_s: float
    bad_signatures: int
    old_boots: int = 0
    clock_problem: str
    """Why the target's clock is not related to ours."""
    aoa_ready: bool
    recorder_failed: bool
    free_mib: float
    network_problem: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadinessLimits:
    """The configuration's part in it."""

    silent_s: float
    min_battery: float
    min_free_mib: float


_CHOOSE_HOLD: Final = "choose Hold at the ground station"
_NOT_ON_THE_GROUND: Final = frozenset({FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.RETURN, FlightMode.MISSION})
"""PX4 does not arm in these, or begins something else than we ask for."""
_HEARTBEAT_S: Final = 2.0
_ESTIMATOR_S: Final = 3.0
_TIMESYNC_S: Final = 3.0


def readiness_problems(now: Readiness, limits: ReadinessLimits) -> list[str]:
    """All that is missing, in words."""
    linked = not now.autopilot_problem and now.heartbeat_age_s <= _HEARTBEAT_S
    low = now.battery is not None and now.battery < limits.min_battery
    silent = ", ".join(map(str, now.batteries_unknown))
    problems = {
        "the service observes; mission.control: fly lets it be engaged": now.observes,
        f"no heartbeat of the autopilot{': ' if now.autopilot_problem else ''}{now.autopilot_problem}": not linked,
        "the autopilot has no local position": not now.has_position,
        "the autopilot tells no heading (ATTITUDE)": linked and now.has_position and not now.has_heading,
        "the autopilot's estimator tells nothing of itself": linked and now.estimator_age_s > _ESTIMATOR_S,
        "the autopilot's estimator is not healthy": now.estimator_age_s <= _ESTIMATOR_S and not now.estimator_healthy,
        "the autopilot has no global position, without which it cannot hold: with GPS wait for a fix; without, it is "
        "given an origin (autopilot.origin_deg) once it takes our poses": now.position_is_global is False,
        f"the vehicle is outside gate.fence_*: {now.outside_fence}": bool(now.outside_fence),
        "two vehicles of one system id are on the link: give each its own MAV_SYS_ID": now.are_two,
        other_vehicle(now.not_px4, now.vehicle): bool(now.not_px4),
        "the autopilot does not tell whether it is in the air (EXTENDED_SYS_STATE)": linked and now.landed_unknown,
        _mode_problem(now): True,
        f"PX4's own arming checks fail: {'; '.join(now.arming_reasons) or 'it has not said why'}": linked
        and not now.armed
        and now.can_arm is False,
        "clocks: the autopilot takes no part in TIMESYNC": linked and now.timesync_age_s > _TIMESYNC_S,
        "clocks: the vehicle's own time is not known yet, in which poses are stamped": linked and not now.time_known,
        "no battery tells how full it is (BATTERY_STATUS)": linked and now.battery is None,
        f"battery {silent} is silent, or does not know how full it is": linked and bool(silent),
        f"the battery is low: {100 * (now.battery or 0):.0f} %, wanted {100 * limits.min_battery:.0f}": low,
        f"no fresh poses: {now.pose_problem}": bool(now.pose_problem),
        now.north_problem: bool(now.north_problem),
        f"the robots' network: {now.network_problem}": bool(now.network_problem),
        **dict.fromkeys(target_problems(now, limits), True),
        "the AOA worker is not ready": not now.aoa_ready,
        "the recorder has stopped": now.recorder_failed,
        f"the disk has {now.free_mib:.0f} MiB left, wanted {limits.min_free_mib:.0f}": now.free_mib
        < limits.min_free_mib,
    }
    return [text for text, is_so in problems.items() if is_so and text]


def target_problems(now: Readiness, limits: ReadinessLimits) -> list[str]:
    """What is missing of the robot that is to be flown to, in words."""
    forged = f" ({now.bad_signatures} came with a wrong signature: compare the keys)" if now.bad_signatures else ""
    old = f" ({now.old_boots} came of a boot before one heard already: see the log)" if now.old_boots else ""
    problems = {
        f"no datagrams of the target{forged}{old}": now.datagram_age_s > limits.silent_s,
        "no packets of the target": now.packet_age_s > limits.silent_s,
        # Nothing can be related before packets and datagrams come, and that is said already.
        now.clock_problem: bool(now.clock_problem) and max(now.datagram_age_s, now.packet_age_s) <= limits.silent_s,
    }
    return [text for text, is_so in problems.items() if is_so]


def other_vehicle(told: str, vehicle: str = "copter") -> str:
    """What is wrong with a vehicle that says it is `told`, where that is no PX4 on such a `vehicle`."""
    other = "a multicopter" if told == "px4" else told.removeprefix("px4 on ")
    if other == told:
        return f"the vehicle is no PX4 but {told}"
    wanted = {"copter": "multicopter", "rover": "ground rover"}[vehicle]
    return f"the vehicle is no {wanted} but {other}" + {
        "a ground rover": "; mission.vehicle: rover is for such a one",
        "a multicopter": "; mission.vehicle: copter is for such a one",
    }.get(other, "")


def _mode_problem(now: Readiness) -> str:
    """Why the vehicle's mode is none to be engaged in, and what a person does about it; empty when it is one."""
    intended = now.mode if now.intended_mode is None else now.intended_mode
    if now.failsafe:
        return f"the autopilot is in a failsafe (asked for {intended}, flies {now.mode}): {_CHOOSE_HOLD}"
    if now.in_air and now.mode is not FlightMode.HOLD:
        return f"the vehicle is flown in mode {now.mode}; put it into hold first"
    if now.in_air and intended is not FlightMode.HOLD:
        return f"the vehicle holds, but was asked for {intended} and may go back to it: {_CHOOSE_HOLD}"
    if now.vehicle == "rover" and not now.in_air and intended is not FlightMode.HOLD:
        return f"the rover stands in mode {intended}, in which it would be armed: {_CHOOSE_HOLD}"
    if not now.in_air and intended in _NOT_ON_THE_GROUND:
        return f"the vehicle stands in mode {intended}, in which it does not arm: {_CHOOSE_HOLD}"
    return ""
