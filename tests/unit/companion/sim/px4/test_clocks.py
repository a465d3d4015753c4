"""How PX4 follows the companion's clock."""

from __future__ import annotations

import pytest

from companion.core.clock import NS_PER_S
from companion.sim.px4.clocks import ClockFilter


def test_timesync_converges_after_five_hundred_answers_and_starts_again_after_a_jump() -> None:
    clock, theirs_ns = ClockFilter(), 6844 * NS_PER_S
    for count in range(500):
        now_ns = count * NS_PER_S // 10
        assert not clock.has_converged and clock.own_time_ns(now_ns, 5) == now_ns
        clock.answer(now_ns + 2_000_000, theirs_ns + now_ns + 1_000_000, now_ns)
    assert clock.has_converged
    assert clock.own_time_ns(0, theirs_ns + 7) == pytest.approx(7, abs=1000)
    clock.answer(60 * NS_PER_S + 20_000_000, 1, 60 * NS_PER_S)
    assert clock.samples == 500, "a round trip of 20 ms is not used"
    for _ in range(11):
        clock.answer(60 * NS_PER_S, theirs_ns, 60 * NS_PER_S)
    assert not clock.has_converged
