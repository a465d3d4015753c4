"""Every fault of the mission: when it is noticed at the latest, by what, and what clears it. Pure.

What is done about it stands in `mission.TABLE`; docs/mission.md shows both together, generated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.autopilot.batteries import FRESH_S
from companion.core.inputs import Event
from companion.mission.conditions import (
    BATTERY_UNKNOWN_S,
    HEARTBEAT_LOST_S,
    MODE_LOST_S,
    SLEPT_S,
    STALLED_S,
    TIME_LIMITS_S,
)
from companion.pose.health import HealthLimits

_TICK_S: Final = 0.05
_CONFIRM_S: Final = 3.0
_POSE: Final = HealthLimits()


@dataclass(frozen=True, slots=True)
class Fault:
    """`within` is the longest time from the fault to its event; configuration keys stand for their values."""

    within: str
    noticed_by: str
    cleared_by: str


_PERSON: Final = "a person engages again"

FAULTS: Final[dict[Event, Fault]] = {
    Event.TASK_FAILED: Fault(
        "at once", "the task group: any part that raises ends the service", "a restart, which starts idle"
    ),
    Event.MODE_LOST: Fault(
        f"{_TICK_S:g} s after CURRENT_MODE, which PX4 sends on each change",
        "a mode that is not ours in this state, also one that is gone again; a restart",
        _PERSON,
    ),
    Event.STALLED: Fault(
        f"{STALLED_S:g} s; {SLEPT_S:g} s of a suspended host",
        "the gap since the last set point that went out, at the first tick after it; CLOCK_BOOTTIME against "
        "CLOCK_MONOTONIC; the vehicle's clock, if it leapt ahead of ours, at its first message",
        _PERSON,
    ),
    Event.LINK_LOST: Fault(
        f"{max(MODE_LOST_S, HEARTBEAT_LOST_S):g} s",
        "the age of HEARTBEAT (asked for when late) and of the mode",
        _PERSON,
    ),
    Event.ABORT: Fault(f"{_TICK_S:g} s", "`companion abort`, or the RC switch moved down", _PERSON),
    Event.POSE_LOST: Fault(
        f"{_POSE.failed_s + _TICK_S:g} s of NaN or failed tracking; pose.lost_s of silence",
        "pose health",
        "it has landed; then " + _PERSON,
    ),
    Event.BATTERY_LOW: Fault("1 s", "BATTERY_STATUS below mission.min_battery", "it has landed; then " + _PERSON),
    Event.BATTERY_UNKNOWN: Fault(
        f"{FRESH_S + BATTERY_UNKNOWN_S:g} s of silence, {BATTERY_UNKNOWN_S:g} s of an unknown charge",
        "a BATTERY_STATUS that stays away, or tells no charge",
        "it has landed; then " + _PERSON,
    ),
    Event.OFFBOARD_REFUSED: Fault(f"{_CONFIRM_S:g} s", "HEARTBEAT or CURRENT_MODE does not show OFFBOARD", _PERSON),
    Event.TAKEOFF_FAILED: Fault(
        f"{_CONFIRM_S:g} s, or the time of the climb", "telemetry does not show the climb", _PERSON
    ),
    Event.PREFLIGHT_FAILED: Fault("before arming", "the preflight's list", "the list is worked off; then " + _PERSON),
    Event.LANDED: Fault("0.25 s", "EXTENDED_SYS_STATE", _PERSON),
    Event.TIMEOUT: Fault(
        "mission.limit_s of acquiring or approaching; mission.hold_limit_s of holding; "
        + ", ".join(f"{limit_s:g} s of {state}" for state, limit_s in TIME_LIMITS_S.items()),
        "the time in the state",
        "it has landed; then " + _PERSON,
    ),
    Event.POSE_STALE: Fault(
        "pose.stale_s", "the age of the newest usable pose", "fresh poses, by itself after 5 s of holding"
    ),
    Event.BEARING_STALE: Fault(
        "aperture.silent_s, or aperture.blind_legs apertures",
        "the age of the target's packets and datagrams; apertures' worth of path without one",
        "the target is heard again, or another try after 5 s of holding, by itself",
    ),
}
"""In order of severity, worst first."""
