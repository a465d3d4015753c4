"""Sockets read as a network driver reads its card: the first datagram wakes us, what follows it is polled.

What wakes an event loop finds caches that are others' by then, and that costs more than a datagram does. So while
anything arrives, all sockets are read together, once a period, and one that had something since the turn before is not
watched until the next (as the kernel's NAPI does). One that had nothing is watched: what its sender was late with comes
in a burst, which a Unix socket's short queue does not hold for a period. Within a socket nothing changes places.

Turns are on the beat (`companion.core.clock.next_beat_ns`), and half of them on that of the control loop, which looks
in the same wake and just behind them: what decides has seen all that arrived until then.

What is read late must not be stamped late. Datagrams bring times of their own, or the kernel's (`csi_bridge.arrival`).
Where there are none, the first datagram behind each turn is still read at once.

That is for a service that waits. While a vehicle flies each datagram is read when it comes: a loop that is late has
then lost nothing yet, and the processor's time is worth less than a pose.
"""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Callable
from typing import Final, Protocol

PERIOD_S: Final = 0.025
AT_ONCE: Final = 256
"""Where a drain took so many, more may wait; that is taken as soon as others have had their turn."""
_EARLY_S: Final = 1e-4
_FEW: Final = 6
"""Datagrams that may wait in one socket; a Unix socket holds 11 (net.unix.max_dgram_qlen). More of them, sooner."""

Drain = Callable[[], int]
"""Takes what waits in a socket, without blocking; how many datagrams that were."""


class Readers(Protocol):
    """What calls a `Drain` when its socket has something: an event loop, or `CoalescedReaders`."""

    def add_reader(self, fd: int, callback: Drain, /) -> object: ...

    def remove_reader(self, fd: int, /) -> object: ...


class CoalescedReaders:
    """For one event loop. `period_s` is how long a datagram may wait there, while `may_wait` says that it may."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        period_s: float = PERIOD_S,
        may_wait: Callable[[], bool] = lambda: True,
    ) -> None:
        self._loop = loop
        self._period_s = period_s
        self._may_wait = may_wait
        self._drains: dict[int, Drain] = {}
        self._unstamped: set[int] = set()
        self._deep: set[int] = set()
        self._watched: set[int] = set()
        self._found: Counter[int] = Counter()
        """Datagrams since the last turn."""
        self._timer: asyncio.TimerHandle | None = None
        """Of the next turn; None while nothing arrives."""

    def add_reader(self, fd: int, callback: Drain, /, is_stamped: bool = True, is_deep: bool = False) -> None:
        """`is_stamped`: when each datagram arrived is known, however late it is read. `is_deep`: the socket holds all
        that a sender that was late may send at once, and need not be watched while there are turns."""
        self._drains[fd] = callback
        if not is_stamped:
            self._unstamped.add(fd)
        elif is_deep:
            self._deep.add(fd)
        self._watch(fd)

    def deep(self) -> Readers:
        """Adds readers whose sockets are deep."""
        return _Deep(self)

    def remove_reader(self, fd: int, /) -> None:
        """Harmless when repeated. Before the socket is closed: its number may be another's then."""
        self._ignore(fd)
        self._unstamped.discard(fd)
        self._deep.discard(fd)
        self._drains.pop(fd, None)
        if not self._drains and self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def read(self) -> None:
        """What waits now, for whoever needs the newest."""
        for fd in list(self._drains):
            self._drain(fd)

    def _woken(self, fd: int) -> None:
        if self._timer is None:
            if self._may_wait():
                self._timer = self._loop.call_at(self._beat_s(), self._turn)
        elif fd in self._unstamped:
            self._ignore(fd)
        self._drain(fd)

    def _turn(self) -> None:
        self.read()
        found, self._found = self._found, Counter()
        most, self._timer = max(found.values(), default=0), None
        if not self._may_wait():
            found.clear()
        elif most and self._drains:
            soon_s = self._loop.time() + (0.0 if most >= AT_ONCE else self._period_s * _FEW / most)
            self._timer = self._loop.call_at(min(soon_s, self._beat_s()), self._turn)
        for fd in self._drains:
            if (found[fd] and fd not in self._unstamped) or (fd in self._deep and self._timer is not None):
                self._ignore(fd)
            else:
                self._watch(fd)

    def _beat_s(self) -> float:
        """Of the loop's clock, which is the monotonic one; a timer may fire a little early."""
        return (math.floor((self._loop.time() + _EARLY_S) / self._period_s) + 1) * self._period_s

    def _watch(self, fd: int) -> None:
        if fd not in self._watched:
            self._watched.add(fd)
            self._loop.add_reader(fd, self._woken, fd)

    def _ignore(self, fd: int) -> None:
        if fd in self._watched:
            self._watched.discard(fd)
            self._loop.remove_reader(fd)

    def _drain(self, fd: int) -> None:
        drain = self._drains.get(fd)  # one before it may have closed it
        try:
            self._found[fd] += 0 if drain is None else drain()
        except Exception as error:  # noqa: BLE001 - one that fails is told as the loop tells it, and stops no other
            self._loop.call_exception_handler({"message": f"Exception in callback {drain!r}", "exception": error})


class _Deep:
    def __init__(self, readers: CoalescedReaders) -> None:
        self._readers = readers

    def add_reader(self, fd: int, callback: Drain, /) -> None:
        self._readers.add_reader(fd, callback, is_deep=True)

    def remove_reader(self, fd: int, /) -> None:
        self._readers.remove_reader(fd)
