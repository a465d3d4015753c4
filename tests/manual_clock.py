"""A clock whose time passes only when somebody sleeps, or says so."""

from __future__ import annotations

import asyncio

from companion.core.clock import NS_PER_S


class ManualClock:
    """A `companion.core.clock.Clock`."""

    def __init__(self, now_ns: int = 0) -> None:
        self._now_ns = now_ns

    def now_ns(self) -> int:
        return self._now_ns

    def advance(self, seconds: float) -> None:
        self._now_ns += round(seconds * NS_PER_S)

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        self._now_ns = max(self._now_ns, deadline_ns)
        await asyncio.sleep(0)
