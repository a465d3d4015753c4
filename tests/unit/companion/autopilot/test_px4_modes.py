"""PX4's custom modes and what they mean to us."""

from __future__ import annotations

import pytest

from companion.autopilot import px4_modes
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


def test_px4_modes_as_they_are_asked_for_and_told() -> None:
    assert (px4_modes.OFFBOARD, px4_modes.HOLD) == ((6, 0), (4, 3))
    assert (px4_modes.LAND, px4_modes.RETURN) == ((4, 6), (4, 5))
    told = [
        flight_mode(8 << 16),
        flight_mode(9 << 16),
        flight_mode(4 << 16 | 10 << 24),
        flight_mode(4 << 16 | 11 << 24),
    ]
    assert told == [FlightMode.MANUAL, FlightMode.OTHER, FlightMode.TAKEOFF, FlightMode.OTHER]
    assert flight_mode(3 << 24) is FlightMode.OTHER and flight_mode(10 << 16 | 3 << 24) is FlightMode.OTHER
