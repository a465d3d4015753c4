"""Which autopilot a heartbeat is of, and of what vehicle, by the names that people and configurations use."""

from __future__ import annotations

from typing import Final

_KINDS: Final = {3: "ardupilot", 12: "px4"}
"""MAV_AUTOPILOT."""
_MULTICOPTERS: Final = frozenset({2, 3, 4, 13, 14, 15, 29, 35, 43})
_ROVER: Final = 10
_OTHERS: Final = {
    1: "a fixed wing", 7: "an airship", 8: "a balloon", 9: "a rocket", _ROVER: "a ground rover", 11: "a boat",
    12: "a submarine", 28: "a parafoil", **dict.fromkeys(range(19, 26), "a VTOL"),
}  # fmt: skip
"""MAV_TYPE. PX4 flies them all, and only the first kind understands our set points."""


def kind_of(autopilot: int, vehicle: int) -> str:
    """Of a HEARTBEAT's `autopilot` and `type`: "px4" of a multicopter, "px4 on a fixed wing" of another vehicle."""
    name = _KINDS.get(autopilot, f"autopilot {autopilot}")
    return name if vehicle in _MULTICOPTERS else f"{name} on {_OTHERS.get(vehicle, f'a vehicle of MAV_TYPE {vehicle}')}"


def drives(kind: str) -> bool:
    """Whether `kind_of` said it of a ground rover."""
    return kind.endswith(_OTHERS[_ROVER])
