"""PX4's custom modes and what they mean to us."""

from __future__ import annotations

from typing import Any

import pytest

from companion.autopilot import px4_modes
from companion.autopilot.px4_modes import flight_mode, left_offboard
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


@pytest.mark.parametrize(
    ("before", "told", "times"),
    [
        ({}, {}, None),
        ({}, {"mode": FlightMode.HOLD}, None),
        ({"mode": FlightMode.OFFBOARD}, {"armed": True}, None),
        ({"mode": FlightMode.OFFBOARD}, {"mode": FlightMode.OFFBOARD}, None),
        ({"mode": FlightMode.HOLD}, {"mode": FlightMode.OFFBOARD}, None),
        ({"mode": FlightMode.HOLD}, {"mode": FlightMode.LAND}, None),
        ({"mode": FlightMode.RETURN}, {"mode": FlightMode.LAND}, None),
        ({"mode": FlightMode.OFFBOARD}, {"mode": FlightMode.HOLD}, 1),
        ({"mode": FlightMode.OFFBOARD, "offboard_left": 1}, {"mode": FlightMode.TAKEOFF}, 2),
        ({"mode": FlightMode.OFFBOARD, "offboard_left": 2}, {"mode": FlightMode.HOLD}, 3),
    ],
)
def test_how_often_offboard_was_left(before: dict[str, Any], told: dict[str, Any], times: int | None) -> None:
    assert left_offboard(before, told) == ({} if times is None else {"offboard_left": times})
