"""An event loop whose time goes on only while nobody has anything to do: whole missions in a fraction of a second."""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Callable

from companion.core.clock import NS_PER_S

Advance = Callable[[int], None]


class MissionClock:
    """A `companion.core.clock.Clock`; `asyncio.sleep` and `asyncio.timeout` of a `MissionLoop` go by it too."""

    def __init__(self, t_ns: int = 10 * NS_PER_S) -> None:
        self.t_ns = t_ns
        self.suspended_ns = 0
        """How long this clock has stood still while the host was suspended."""

    def now_ns(self) -> int:
        return self.t_ns

    def boot_ns(self) -> int:
        """CLOCK_BOOTTIME, which goes on in a suspended host."""
        return self.t_ns + self.suspended_ns

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        loop = asyncio.get_running_loop()
        woken = loop.create_future()
        alarm = loop.call_at(deadline_ns / NS_PER_S, _wake, woken)
        try:
            await woken
        finally:
            alarm.cancel()


def _wake(sleeper: asyncio.Future[None]) -> None:
    if not sleeper.done():
        sleeper.set_result(None)


class _Selector(selectors.SelectSelector):
    """Waits for nothing but time."""

    def __init__(self, clock: MissionClock) -> None:
        super().__init__()
        self._clock = clock
        self.advance: Advance | None = None

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            raise RuntimeError("every task waits for something that never comes")
        if timeout > 0 and self.advance is not None:
            self.advance(self._clock.t_ns + max(1, math.ceil(timeout * NS_PER_S)))
        return []


class MissionLoop(asyncio.SelectorEventLoop):
    def __init__(self, clock: MissionClock) -> None:
        self._of = _Selector(clock)
        self._clock = clock
        super().__init__(self._of)

    def time(self) -> float:
        return self._clock.t_ns / NS_PER_S

    def connect(self, advance: Advance) -> None:
        """`advance` moves the world and the clock to a time, or further when this program stands still meanwhile."""
        self._of.advance = advance
