"""An event loop whose time goes on only while nobody has anything to do: whole missions in a fraction of a second.

It calls what asyncio's own would, in the same order (up to a hundred timers), without what a mission has no use for:
sockets, threads, signals, a context for each call. Those cost more than most of what is called.
"""

from __future__ import annotations

import asyncio
import heapq
import logging
import math
from asyncio import events
from collections import deque
from collections.abc import Callable, Coroutine
from contextvars import Context
from typing import Any, Final, cast

from companion.core.clock import NS_PER_S

Advance = Callable[[int], None]
_LOG = logging.getLogger(__name__)
_RESOLUTION_S: Final = 1e-9
"""Whoever wants to wake within this of now is woken."""


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
        except asyncio.CancelledError:
            alarm.cancel()
            raise


def _wake(sleeper: asyncio.Future[None]) -> None:
    if not sleeper.done():
        sleeper.set_result(None)


class _Call(float):
    """Something to be called, as the number of when [s]: the heap compares nothing else."""

    __slots__ = ("args", "callback")
    callback: Callable[..., object] | None
    args: tuple[Any, ...]

    def cancel(self) -> None:
        self.callback = None


def _call(when_s: float, callback: Callable[..., object], args: tuple[Any, ...]) -> _Call:
    call = _Call(when_s)
    call.callback, call.args = callback, args
    return call


class MissionLoop:
    """As much of `asyncio.AbstractEventLoop` as sleeping tasks ask for; `run_until_complete` is what it is for."""

    def __init__(self, clock: MissionClock) -> None:
        self._clock = clock
        self._ready = deque[_Call]()
        self._later: list[_Call] = []
        self._advance: Advance | None = None

    def connect(self, advance: Advance) -> None:
        """`advance` moves the world and the clock to a time, or further when this program stands still meanwhile."""
        self._advance = advance

    def time(self) -> float:
        return self._clock.t_ns / NS_PER_S

    def run_until_complete(self, future: Coroutine[Any, Any, Any]) -> Any:
        events._set_running_loop(cast(Any, self))
        try:
            task = self.create_task(future)
            while not task.done():
                self._turn()
            return task.result()
        finally:
            events._set_running_loop(None)

    def _turn(self) -> None:
        """All that was ready before it, and all that is due by then."""
        ready, later = self._ready, self._later
        while later and later[0].callback is None:
            heapq.heappop(later)
        if not ready:
            if not later:
                raise RuntimeError("every task waits for something that never comes")
            timeout_s = later[0] - self.time()
            if timeout_s > 0 and self._advance is not None:
                self._advance(self._clock.t_ns + max(1, math.ceil(timeout_s * NS_PER_S)))
        end_s = self.time() + _RESOLUTION_S
        while later and later[0] < end_s:
            ready.append(heapq.heappop(later))
        for _ in range(len(ready)):
            call = ready.popleft()
            if call.callback is not None:
                call.callback(*call.args)

    def call_soon(self, callback: Callable[..., object], *args: Any, context: Context | None = None) -> _Call:
        call = _call(0.0, callback, args)
        self._ready.append(call)
        return call

    def call_at(self, when: float, callback: Callable[..., object], *args: Any) -> _Call:
        call = _call(when, callback, args)
        heapq.heappush(self._later, call)
        return call

    def call_later(self, delay: float, callback: Callable[..., object], *args: Any) -> _Call:
        return self.call_at(self.time() + delay, callback, *args)

    def create_future(self) -> asyncio.Future[Any]:
        return asyncio.Future(loop=cast(Any, self))

    def create_task(self, coro: Any, *, name: str | None = None) -> asyncio.Task[Any]:
        return asyncio.Task(coro, loop=cast(Any, self), name=name)

    def get_debug(self) -> bool:
        return False

    def is_running(self) -> bool:
        return True

    def is_closed(self) -> bool:
        return False

    def call_exception_handler(self, context: dict[str, Any]) -> None:
        _LOG.error(context["message"], exc_info=context.get("exception"))
