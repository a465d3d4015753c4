"""Monotonic time, injected wherever time matters so that tests can hold it still."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable
from typing import Protocol

NS_PER_S = 1_000_000_000


def age_s(t_ns: int | None, now_ns: int) -> float:
    """From then until now; infinite for what never was."""
    return math.inf if t_ns is None else (now_ns - t_ns) / NS_PER_S


def next_beat_ns(now_ns: int, period_ns: int) -> int:
    """The next whole multiple of a period. What is done by such times is done together: one wake of the event loop for
    all that is due, and caches that are still its own."""
    return (now_ns // period_ns + 1) * period_ns


class Clock(Protocol):
    """Time as control sees it: monotonic nanoseconds, never wall time."""

    def now_ns(self) -> int: ...

    async def sleep_until_ns(self, deadline_ns: int) -> None: ...


class MonotonicClock:
    """The host's CLOCK_MONOTONIC: one time base for all processes of the host."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        await asyncio.sleep(max(0, deadline_ns - time.monotonic_ns()) / NS_PER_S)


class HostSleep:
    """How long the host was suspended: CLOCK_MONOTONIC stands still then, so nothing that is judged by it grows old;
    CLOCK_BOOTTIME goes on. To be asked again and again."""

    def __init__(
        self,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        boot_ns: Callable[[], int] = lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME),
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._boot_ns = boot_ns
        self._apart_ns = self._read()[1]

    def seconds(self) -> float:
        """Since the last call. A thread that is held up between two clocks must not look like it: at least so long."""
        least_ns, most_ns = self._read()
        slept_ns, self._apart_ns = least_ns - self._apart_ns, most_ns
        return max(0, slept_ns) / NS_PER_S

    def _read(self) -> tuple[int, int]:
        """Between which the clocks are apart [ns]."""
        before_ns = self._monotonic_ns()
        boot_ns = self._boot_ns()
        return boot_ns - self._monotonic_ns(), boot_ns - before_ns


class Ticker:
    """Ticks at absolute deadlines, the beats of its period. A late tick is counted as an overrun and the missed
    deadlines are skipped: a control loop that fell behind must act on fresh data, not catch up on old deadlines."""

    def __init__(self, clock: Clock, rate_hz: float) -> None:
        self._clock = clock
        self._period_ns = round(NS_PER_S / rate_hz)
        self.overruns = 0

    async def ticks(self) -> AsyncIterator[int]:
        """Yields the time of each tick [ns]."""
        deadline_ns = next_beat_ns(self._clock.now_ns(), self._period_ns)
        while True:
            await self._clock.sleep_until_ns(deadline_ns)
            now_ns = self._clock.now_ns()
            missed = (now_ns - deadline_ns) // self._period_ns
            if missed > 0:
                self.overruns += missed
                deadline_ns += missed * self._period_ns
            yield now_ns
            deadline_ns += self._period_ns
