"""The vehicle's clock from exchanges with all sorts of round trips, and the two things it tells."""

from __future__ import annotations

import random

import pytest

from companion.autopilot.vehicle_clock import Turn, VehicleClock
from companion.core.clock import NS_PER_S

_OFFSET_NS = -6787 * NS_PER_S


def _exchange(clock: VehicleClock, now_ns: int, there_ns: int, back_ns: int, offset_ns: int = _OFFSET_NS) -> int:
    asked_ns = clock.request(now_ns)
    assert clock.answer(now_ns + there_ns + offset_ns, asked_ns, now_ns + there_ns + back_ns)
    return now_ns + there_ns + back_ns


def test_the_offset_is_good_to_half_of_the_best_round_trip() -> None:
    clock, rng, now_ns = VehicleClock(), random.Random(1), 6844 * NS_PER_S
    assert clock.at(now_ns) is None
    for _ in range(50):
        now_ns = _exchange(clock, now_ns + NS_PER_S // 10, 300_000, rng.choice((400_000, 30_000_000, 200_000_000)))
        assert clock.offset_ns is not None
    assert clock.at(now_ns) == pytest.approx(now_ns + _OFFSET_NS, abs=2_500_000)


def test_answers_to_others_and_late_ones_are_not_ours() -> None:
    clock, now_ns = VehicleClock(), 6844 * NS_PER_S
    asked_ns = clock.request(now_ns)
    assert not clock.answer(57 * NS_PER_S, asked_ns + 1, now_ns + 1000)
    assert not clock.answer(57 * NS_PER_S, asked_ns, now_ns + 2 * NS_PER_S)
    assert clock.offset_ns is None


def test_a_clock_of_another_rate_is_followed() -> None:
    clock, now_ns = VehicleClock(), 6844 * NS_PER_S
    for count in range(600):
        offset_ns = _OFFSET_NS - round(0.015 * count * NS_PER_S / 10)
        now_ns = _exchange(clock, 6844 * NS_PER_S + count * NS_PER_S // 10, 500_000, 500_000, offset_ns)
    assert clock.at(now_ns) == pytest.approx(now_ns + offset_ns, abs=2_000_000)


def test_a_step_back_is_a_restart_and_forgets_the_offset() -> None:
    clock, now_ns = VehicleClock(), 6844 * NS_PER_S
    assert clock.told(57 * NS_PER_S, now_ns) is None
    now_ns = _exchange(clock, now_ns, 500_000, 500_000)
    assert clock.told(57 * NS_PER_S - 200_000_000, now_ns) is None, "out of order"
    assert clock.told(3 * NS_PER_S, now_ns + NS_PER_S) is Turn.RESTARTED
    assert clock.offset_ns is None
    assert clock.told(3 * NS_PER_S + 20_000_000, now_ns + NS_PER_S + 20_000_000) is None


def test_a_leap_ahead_is_our_own_standstill_and_a_queue_that_empties_is_none() -> None:
    clock, now_ns, own_ns = VehicleClock(), 6844 * NS_PER_S, 57 * NS_PER_S
    for _ in range(200):
        now_ns, own_ns = now_ns + 20_000_000, own_ns + 20_000_000
        assert clock.told(own_ns, now_ns) is None
    now_ns += 2 * NS_PER_S  # the program stood still, its clock did not: a queue of old messages
    for count in range(100):
        own_ns += 20_000_000
        assert clock.told(own_ns, now_ns + count * 1000) is None
    own_ns += 5 * NS_PER_S
    assert clock.told(own_ns, now_ns + 20_000_000) is Turn.LEAPT
    assert clock.stood_still_ns == pytest.approx(5 * NS_PER_S, abs=NS_PER_S // 5)
