"""A clock for whole missions in seconds: time goes on only while every task sleeps, to the next who wants to wake."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable

_TURNS = 4
"""Turns of the event loop that a woken task may take, through tasks it starts, before everybody sleeps again."""


class VirtualClock:
    """A `companion.core.clock.Clock`. Tasks that share a deadline wake in the order in which they fell asleep."""

    def __init__(self) -> None:
        self._now_ns = 0
        self._sleepers: list[tuple[int, int, asyncio.Future[None]]] = []
        self._order = 0

    def now_ns(self) -> int:
        return self._now_ns

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        if deadline_ns <= self._now_ns:
            await asyncio.sleep(0)
            return
        future = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (deadline_ns, self._order, future))
        self._order += 1
        await future

    async def run(self, live: Callable[[int], bool]) -> None:
        """Until `live`, called with each new time before anybody wakes, says False or nobody sleeps any more."""
        while True:
            for _ in range(_TURNS):
                await asyncio.sleep(0)
            if not self._sleepers:
                return
            self._now_ns = self._sleepers[0][0]
            if not live(self._now_ns):
                return
            while self._sleepers and self._sleepers[0][0] <= self._now_ns:
                future = heapq.heappop(self._sleepers)[2]
                if not future.done():
                    future.set_result(None)
