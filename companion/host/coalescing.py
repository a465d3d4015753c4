"""Sockets read as a network driver reads its card: the first datagram wakes us, what follows it is polled.

What wakes an event loop finds caches that are others' by then, and that costs more than a datagram does. So while
anything arrives, all sockets are read together, once a period, and none is watched; a turn that finds nothing has them
watched again (as the kernel's NAPI does). Within a socket nothing is lost or changes places: what is not read yet waits
there.

What is read late must not be stamped late. Datagrams bring times of their own, or the kernel's (`csi_bridge.arrival`).
Where there are none, the first datagram behind each turn is still read at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

PERIOD_S: Final = 0.02
AT_ONCE: Final = 256
"""Where a drain took so many, more may wait; that is taken as soon as others have had their turn."""
_FEW: Final = 6
"""Datagrams that may wait in one socket; a Unix socket holds 11 (net.unix.max_dgram_qlen). More of them, sooner."""

Drain = Callable[[], int]
"""Takes what waits in a socket, without blocking; how many datagrams that were."""


class Readers(Protocol):
    """What calls a `Drain` when its socket has something: an event loop, or `CoalescedReaders`."""

    def add_reader(self, fd: int, callback: Drain, /) -> object: ...

    def remove_reader(self, fd: int, /) -> object: ...


class CoalescedReaders:
    """For one event loop. `period_s` is how long a datagram may wait there."""

    def __init__(self, loop: asyncio.AbstractEventLoop, period_s: float = PERIOD_S) -> None:
        self._loop = loop
        self._period_s = period_s
        self._drains: dict[int, Drain] = {}
        self._unstamped: set[int] = set()
        self._timer: asyncio.TimerHandle | None = None
        """Of the next turn; None while the sockets are watched."""

    def add_reader(self, fd: int, callback: Drain, /, is_stamped: bool = True) -> None:
        """`is_stamped`: when each datagram arrived is known, however late it is read."""
        self._drains[fd] = callback
        if not is_stamped:
            self._unstamped.add(fd)
        if self._timer is None or not is_stamped:
            self._loop.add_reader(fd, self._woken, fd)

    def remove_reader(self, fd: int, /) -> None:
        """Harmless when repeated. Before the socket is closed: its number may be another's then."""
        if self._drains.pop(fd, None) is not None:
            self._unstamped.discard(fd)
            self._loop.remove_reader(fd)
        if not self._drains and self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def read(self) -> None:
        """What waits now, for whoever needs the newest."""
        for fd in list(self._drains):
            self._drain(fd)

    def _woken(self, fd: int) -> None:
        if self._timer is None:
            for one in self._drains:
                self._loop.remove_reader(one)
            self._turn()
        else:
            self._loop.remove_reader(fd)  # one that is not stamped: until the next turn
            self._drain(fd)

    def _turn(self) -> None:
        self._timer = None
        most = max([self._drain(fd) for fd in list(self._drains)], default=0)
        if most:
            wait_s = 0.0 if most >= AT_ONCE else self._period_s * min(1.0, _FEW / most)
            self._timer = self._loop.call_later(wait_s, self._turn)
        for fd in self._unstamped if most else self._drains:
            self._loop.add_reader(fd, self._woken, fd)

    def _drain(self, fd: int) -> int:
        drain = self._drains.get(fd)  # one before it may have closed it
        try:
            return 0 if drain is None else drain()
        except Exception as error:  # noqa: BLE001 - one that fails is told as the loop tells it, and stops no other
            self._loop.call_exception_handler({"message": f"Exception in callback {drain!r}", "exception": error})
            return 0
