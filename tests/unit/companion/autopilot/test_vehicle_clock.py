"""The vehicle's clock from messages with all sorts of delays, and the two things it tells."""

from __future__ import annotations

import random

import pytest

from companion.autopilot.vehicle_clock import Turn, VehicleClock
from companion.core.clock import NS_PER_S

_NOW_NS, _OWN_NS, _MS = 6844 * NS_PER_S, 57 * NS_PER_S, 1_000_000


def test_the_offset_is_that_of_the_least_delayed_message() -> None:
    clock, rng = VehicleClock(), random.Random(1)
    for count in range(200):
        delay_ns = rng.choice((400_000, 3 * _MS, 30 * _MS, 200 * _MS))
        assert clock.told(_OWN_NS + count * 20 * _MS, _NOW_NS + count * 20 * _MS + delay_ns) is None
        assert (clock.at(_NOW_NS) is None) == (count < 9), "one message alone may have been held up"
    assert clock.at(_NOW_NS) == pytest.approx(_OWN_NS, abs=4 * _MS)


@pytest.mark.parametrize("rate", [0.985, 1.0, 1.015])
def test_a_clock_of_another_rate_is_followed(rate: float) -> None:
    clock, rng = VehicleClock(), random.Random(2)
    for count in range(6000):
        t_ns = count * 10 * _MS
        delay_ns = _MS // 2 + (rng.random() < 0.2) * 40 * _MS
        assert clock.told(_OWN_NS + round(rate * t_ns), _NOW_NS + t_ns + delay_ns) is None
        if count > 100:
            assert clock.at(_NOW_NS + t_ns) == pytest.approx(_OWN_NS + rate * t_ns, abs=5 * _MS)


def test_a_step_back_is_a_restart_and_forgets_the_offset() -> None:
    clock = VehicleClock()
    for count in range(20):
        assert clock.told(_OWN_NS + count, _NOW_NS + count) is None
    assert clock.told(_OWN_NS - 200 * _MS, _NOW_NS + 100) is None, "out of order"
    assert clock.told(3 * NS_PER_S, _NOW_NS + NS_PER_S) is Turn.RESTARTED
    assert clock.offset_ns is None
    assert clock.told(3 * NS_PER_S + 20 * _MS, _NOW_NS + NS_PER_S + 20 * _MS) is None


def test_a_leap_ahead_is_our_own_standstill_and_a_queue_that_empties_is_none() -> None:
    clock, now_ns, own_ns = VehicleClock(), _NOW_NS, _OWN_NS
    for _ in range(200):
        now_ns, own_ns = now_ns + 20 * _MS, own_ns + 20 * _MS
        assert clock.told(own_ns, now_ns) is None
    now_ns += 2 * NS_PER_S  # the program stood still, its clock did not: a queue of old messages
    for count in range(100):
        own_ns += 20 * _MS
        assert clock.told(own_ns, now_ns + count * 1000) is None
    own_ns += 5 * NS_PER_S
    assert clock.told(own_ns, now_ns + 20 * _MS) is Turn.LEAPT
    assert clock.stood_still_ns == pytest.approx(5 * NS_PER_S, abs=NS_PER_S // 5)
    assert clock.at(now_ns + 20 * _MS) == own_ns
