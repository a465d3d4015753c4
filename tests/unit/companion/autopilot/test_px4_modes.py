"""PX4's custom modes and what they mean to us."""

from __future__ import annotations

import pytest

from companion.autopilot.px4_modes import flight_mode
from companion.core.messages import FlightMode


@pytest.mark.parametrize(
    ("main", "sub", "mode"),
    [
        (1, 0, FlightMode.MANUAL),
        (2, 0, FlightMode.MANUAL),
        (3, 0, FlightMode.MANUAL),
        (4, 2, FlightMode.TAKEOFF),
        (4, 3, FlightMode.HOLD),
        (4, 4, FlightMode.MISSION),
        (4, 5, FlightMode.RETURN),
        (4, 6, FlightMode.LAND),
        (4, 8, FlightMode.OTHER),
        (4, 9, FlightMode.LAND),
        (5, 0, FlightMode.MANUAL),
        (6, 0, FlightMode.OFFBOARD),
        (7, 0, FlightMode.MANUAL),
        (10, 0, FlightMode.OTHER),
    ],
)
def test_px4_modes(main: int, sub: int, mode: FlightMode) -> None:
    assert flight_mode(main << 16 | sub << 24) is mode
