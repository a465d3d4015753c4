"""Ticks keep absolute deadlines; a stall skips ticks and counts them."""

from __future__ import annotations

import math

from companion.core.clock import NS_PER_S, HostSleep, Ticker, age_s
from tests.manual_clock import ManualClock


async def test_ticks_do_not_drift_and_a_stall_is_counted() -> None:
    clock = ManualClock(3 * NS_PER_S + 1_000)
    ticker = Ticker(clock, 20)
    times = []
    async for now_ns in ticker.ticks():
        times.append(now_ns - 3 * NS_PER_S)
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


class _Host:
    """Its two clocks; `held_up_s` is how long a thread that reads one waits before it reads the other."""

    def __init__(self) -> None:
        self.mono_ns, self.boot_ns, self.held_up_s = 0, 7 * NS_PER_S, 0.0

    def run(self, seconds: float, suspended_s: float = 0.0) -> None:
        self.mono_ns += round(seconds * NS_PER_S)
        self.boot_ns += round((seconds + suspended_s) * NS_PER_S)

    def monotonic(self) -> int:
        now_ns = self.mono_ns
        self.run(self.held_up_s)
        return now_ns

    def boot(self) -> int:
        now_ns = self.boot_ns
        self.run(self.held_up_s)
        return now_ns


def test_fault_41_a_suspended_host_shows_once_and_a_thread_held_up_between_the_clocks_does_not() -> None:
    host = _Host()
    sleep = HostSleep(host.monotonic, host.boot)
    host.run(3.0)
    assert sleep.seconds() == 0.0
    host.run(0.01, suspended_s=5.0)
    assert sleep.seconds() == 5.0
    assert sleep.seconds() == 0.0
    for held_up_s in (0.7, 0.0, 1.3, 0.0):
        host.held_up_s = held_up_s
        assert sleep.seconds() == 0.0
    host.run(1.0, suspended_s=0.25)
    assert sleep.seconds() == 0.25
