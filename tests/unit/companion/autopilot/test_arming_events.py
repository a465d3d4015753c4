"""Numbers and names of PX4's events, and which modes a check is about."""

from __future__ import annotations

import pytest

from companion.autopilot.arming_events import BEGIN, END, concerns, event_number, words
from companion.core.messages import FlightMode


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("commander_arming_check_summary", 27825120),
        ("commander_health_summary", 18691879),
        ("check_estimator_high_accel_bias", 20390844),
        ("check_modes_offboard_signal", 19865031),
        ("check_modes_manual_control", 17231145),
    ],
)
def test_arming_events_have_the_numbers_that_px4_sends(name: str, number: int) -> None:
    """As PX4 1.16 sent them."""
    assert event_number(name) == number


def test_arming_reports_have_a_beginning_and_an_end() -> None:
    assert (BEGIN, END) == (27825120, 18691879)


def test_arming_checks_are_told_by_name_and_unknown_ones_by_number() -> None:
    assert words(20390844) == "estimator high accel bias"
    assert words(1) == "PX4's event 1"


@pytest.mark.parametrize(
    ("modes", "mode", "about"),
    [
        (1 << 4, FlightMode.HOLD, True),
        (1 << 4, FlightMode.OFFBOARD, False),
        (1 << 14, FlightMode.OFFBOARD, True),
        (1 << 10, FlightMode.MANUAL, True),
        (1 << 4, FlightMode.OTHER, True),
        (0, FlightMode.HOLD, False),
        (1 << 30, None, True),
        (0, None, False),
    ],
)
def test_arming_checks_concern_the_modes_of_their_bits(modes: int, mode: FlightMode | None, about: bool) -> None:
    """Of a mode without a bit any check may be about it."""
    assert concerns(modes, mode) is about
