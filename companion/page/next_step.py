"""What a mission's state means for a person, and what comes next. Pure; docs/mission.md has the whole table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

ENDED: Final = "ended"
"""The service was stopped, or has ended with an error that its log names."""
_LEFT_IN: Final = {"hold": "is left in hold", "land": "lands", "return": "flies home"}


def next_step(state: str, control: str, mission: Mapping[str, Any], missing: int = 0) -> str:
    """One sentence for a person. `mission` is that section of the configuration, `missing` how much stands against an
    engagement."""
    match state:
        case "beacon":
            return "Answers frames and broadcasts what it measures; nothing to do."
        case "recording":
            return "An imported recording: its bearings one after the other; it has no mission."
        case "idle" | "latched":
            return _at_rest(control, missing, state)
        case "preflight":
            return "Looks at everything once more, then arms and takes off."
        case "taking_off":
            return f"Climbs to {mission['takeoff_height_m']:g} m, then asks for OFFBOARD."
        case "acquiring":
            return "Flies its weave until a first bearing may steer."
        case "approaching":
            near, sure = mission["arrival_range_m"], 100 * mission["arrival_confidence"]
            return f"Flies to the target until it is within {near:g} m with {sure:.0f} %; then {_leave(mission)}."
        case "holding":
            then = "flies home" if mission["lost_target"] == "return" else "lands"
            return f"Stands still until a bearing can be had again; after {mission['hold_limit_s']:g} s it {then}."
        case "arrived":
            return f"At the target: {_leave(mission)}. Take it over by the transmitter, or land it."
        case "landing":
            return "The autopilot brings it down; keep clear."
        case "fault":
            return "A part of the service died: the vehicle is yours. Restart the service before you engage again."
        case "ended":
            return "The service has ended and left the vehicle to its autopilot; it starts again idle."
    return "No word from the service yet."


def _at_rest(control: str, missing: int, state: str) -> str:
    before = "Hands off: the vehicle is yours. " if state == "latched" else ""
    if control != "fly":
        return f"{before}Only observes; `mission.control: fly` would let a person engage it."
    if missing:
        return f"{before}Not ready: {missing} {'thing stands' if missing == 1 else 'things stand'} against engaging."
    return f"{before}Ready: `companion engage` starts a flight."


def _leave(mission: Mapping[str, Any]) -> str:
    return f"it {_LEFT_IN[mission['leave']]}"
