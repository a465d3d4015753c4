"""Ticks keep absolute deadlines; a stall skips ticks and counts them."""

from __future__ import annotations

import math

from companion.core.clock import NS_PER_S, ManualClock, Ticker, age_s


async def test_ticks_do_not_drift_and_a_stall_is_counted() -> None:
    clock = ManualClock(1_000)
    ticker = Ticker(clock, 20)
    times = []
    async for now_ns in ticker.ticks():
        times.append(now_ns - 1_000)
        clock.advance(0.03)  # the work of a tick
        if len(times) == 3:
            clock.advance(0.5)  # a stall
        if len(times) == 6:
            break
    period_ns = NS_PER_S // 20
    assert times[:3] == [period_ns, 2 * period_ns, 3 * period_ns]
    assert times[3] == round(3.6 * period_ns) + 10 * period_ns
    assert times[4] == times[3] + 30_000_000  # its work ended past the deadline: late by that, but not by more
    assert times[5] == 15 * period_ns
    assert ticker.overruns == 9


def test_what_never_was_is_infinitely_old() -> None:
    assert age_s(None, 5) == math.inf
    assert age_s(5 * NS_PER_S, 7 * NS_PER_S) == 2.0
