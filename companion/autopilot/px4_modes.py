"""PX4's modes as HEARTBEAT.custom_mode carries them: main mode in bits 16..23, sub mode in bits 24..31."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from companion.core.messages import FlightMode

OFFBOARD: Final = (6, 0)
HOLD: Final = (4, 3)
LAND: Final = (4, 6)
RETURN: Final = (4, 5)

_AUTO: Final = 4
_BY_PERSON: Final = (1, 2, 3, 5, 7, 8)
"""Manual, altitude, position, acro, stabilised, rattitude."""
_AUTO_SUB_MODES: Final = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
    9: FlightMode.LAND,  # precision landing
    10: FlightMode.TAKEOFF,  # of a VTOL
}


def flight_mode(custom_mode: int) -> FlightMode:
    """The companion's view of a custom mode; OTHER for one that PX4 may add."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == OFFBOARD[0]:
        return FlightMode.OFFBOARD
    if main in _BY_PERSON:
        return FlightMode.MANUAL
    return _AUTO_SUB_MODES.get(sub, FlightMode.OTHER) if main == _AUTO else FlightMode.OTHER


def left_offboard(before: Mapping[str, Any], told: Mapping[str, Any]) -> dict[str, int]:
    """`VehicleState.offboard_left`, one more where a message tells that the mode is OFFBOARD no longer."""
    if "mode" not in told or before.get("mode") is not FlightMode.OFFBOARD or told["mode"] is FlightMode.OFFBOARD:
        return {}
    return {"offboard_left": before.get("offboard_left", 0) + 1}
