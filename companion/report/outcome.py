"""How a flight went and why it ended, in a sentence; and a word where errors share a sign. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from companion.flight.records import SERVICE_ENDS
from companion.mission.table import AT_REST

_WHY: Final = {
    "task_failed": "a part of the service died",
    "mode_lost": "a pilot or a failsafe took the mode",
    "stalled": "the set point stream stood still",
    "link_lost": "the autopilot fell silent",
    "abort": "a person aborted it",
    "pose_lost": "the poses were lost",
    "battery_low": "the battery was low",
    "battery_unknown": "a battery told nothing any more",
    "offboard_refused": "the autopilot refused OFFBOARD",
    "takeoff_failed": "the take-off failed",
    "preflight_failed": "the look before the flight found something",
    "landed": "the vehicle had landed",
    "timeout": "it took longer than its limit",
}
_FEWEST: Final = 5
_SHARE: Final = 0.8
_TIMES: Final = 3.0
"""A mean error this many of its deviations from zero is no chance."""
Step = tuple[float, Mapping[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Closest:
    """How near the vehicle was to its target [m]: at the end of the approach, and at the nearest; None where it is not
    known. `believed_m` with its deviation is what the flight itself thought at the end."""

    end_m: float | None = None
    nearest_m: float | None = None
    believed_m: float | None = None
    believed_std_m: float | None = None


def outcome(steps: Sequence[Step], closest: Closest, bearings: int, duration_s: float) -> str:
    """One sentence. `steps` are the mission's transitions with their times [s]."""
    flown = [(t_s, step) for t_s, step in steps if step["reason"] != SERVICE_ENDS]
    begun_s = next((t_s for t_s, step in flown if step["next_state"] == "taking_off"), None)
    if begun_s is None:
        return _not_flown(flown, bearings, duration_s)
    arrived_s = next((t_s for t_s, step in flown if step["next_state"] == "arrived"), None)
    if arrived_s is not None:
        return f"Reached the target {arrived_s - begun_s:.0f} s after taking off{_distance(closest)}."
    end = next(((t_s, step) for t_s, step in flown if t_s > begun_s and _ends(step)), None)
    if end is None:
        state = str(flown[-1][1]["next_state"]).replace("_", " ")
        return f"Did not reach the target: the log ends while {state}{_distance(closest)}."
    t_s, step = end
    state = str(step["state"]).replace("_", " ")
    when = f"{t_s - begun_s:.0f} s after taking off, while {state}"
    return f"Did not reach the target: {_why(step)} {when}{_distance(closest)}."


def shared_sign(errors_deg: Sequence[float]) -> str:
    """A word where azimuth errors (estimate less truth) lie to one side; empty where they do not."""
    known = np.array([error for error in errors_deg if math.isfinite(error)])
    if len(known) < _FEWEST:
        return ""
    mean, std = float(np.mean(known)), float(np.std(known, ddof=1))
    same = int(np.count_nonzero(np.sign(known) == np.sign(mean)))
    if same < _SHARE * len(known) or abs(mean) < _TIMES * std / math.sqrt(len(known)):
        return ""
    side = "counter-clockwise" if mean > 0 else "clockwise"
    return (
        f"{same} of {len(known)} azimuth errors lie {side} of the truth, by {abs(mean):.1f}° in the mean: that is no "
        "chance. Most likely North of the poses is turned by about as much (pose.north, pose.north_yaw_deg)."
    )


def _not_flown(flown: Sequence[Step], bearings: int, duration_s: float) -> str:
    refused = [str(step["reason"]) for _, step in flown if step["event"] == "preflight_failed"]
    if refused:
        return f"Did not fly: {refused[-1]}."
    heard = "no bearing" if not bearings else "1 bearing" if bearings == 1 else f"{bearings} bearings"
    return f"Nobody flew: {duration_s:.0f} s were recorded, with {heard}."


def _ends(step: Mapping[str, Any]) -> bool:
    leaves = step["state"] not in AT_REST and step["next_state"] in AT_REST
    return leaves or (step["next_state"] == "landing" and step["state"] != "landing")


def _why(step: Mapping[str, Any]) -> str:
    event, reason = str(step["event"]), str(step["reason"])
    words = _WHY.get(event, event.replace("_", " "))
    return words if reason in ("", event) else f"{words} ({reason.removeprefix(f'{event}: ')})"


def _distance(closest: Closest) -> str:
    parts = []
    if closest.end_m is not None:
        parts.append(f"{closest.end_m:.1f} m from it in truth")
    if closest.believed_m is not None:
        std = "" if closest.believed_std_m is None else f" ± {closest.believed_std_m:.1f}"
        parts.append(f"{closest.believed_m:.1f}{std} m by its own belief")
    nearest = ""
    if closest.nearest_m is not None and closest.end_m is not None and closest.nearest_m < closest.end_m - 0.5:
        nearest = f"; it had been as near as {closest.nearest_m:.1f} m"
    return (", " + ", ".join(parts) if parts else "") + nearest
