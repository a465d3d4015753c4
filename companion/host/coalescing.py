"""Sockets read as a network driver reads its card: the first datagram wakes us, what follows it is polled.

What wakes an event loop finds caches that are others' by then, and that costs more than a datagram does. So while
anything arrives, all sockets are read together, once a period, and one that had something since the turn before is not
watched until the next (as the kernel's NAPI does). One that had nothing is watched: what its sender was late with comes
in a burst, which a Unix socket's short queue does not hold for a period. Within a socket nothing changes places.

Turns are on the beat (`companion.core.clock.next_beat_ns`), and each second one on that of the control loop, which
looks in the same wake and just behind it: what decides has seen all that arrived until then. The turn between two looks
only gathers what a short queue could not hold; what the datagrams mean is worked out once, at the look.

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
from dataclasses import dataclass
from typing import Final, Protocol

PERIOD_S: Final = 0.025
AT_ONCE: Final = 256
"""Where a drain took so many, more may wait; that is taken as soon as others have had their turn."""
TURNS_A_LOOK: Final = 2
"""Of the control loop, 20 times a second."""
_EARLY_S: Final = 1e-4
_FEW: Final = 6
"""Datagrams that may wait in one socket; a Unix socket holds 11 (net.unix.max_dgram_qlen). More of them, sooner."""

Drain = Callable[[], int]
"""Takes what waits in a socket, without blocking; how many datagrams that were."""


class Readers(Protocol):
    """What calls a `Drain` when its socket has something."""

    def add_reader(
        self, fd: int, drain: Drain, /, *, is_stamped: bool = True, is_deep: bool = False, gather: Drain | None = None
    ) -> None:
        """`is_stamped`: when each datagram arrived is known, however late it is read. `is_deep`: the socket holds all
        that may come until the control loop looks. `gather` takes what waits and keeps it for the next drain."""

    def remove_reader(self, fd: int, /) -> None:
        """Harmless when repeated. Before the socket is closed: its number may be another's then."""


@dataclass(frozen=True, slots=True)
class _Socket:
    drain: Drain
    is_stamped: bool
    is_deep: bool
    gather: Drain | None


class CoalescedReaders:
    """For one event loop. `period_s` is how long a datagram may wait in a socket, while `may_wait` says that it may;
    one that is gathered waits for the end of `turns_a_look` periods at most."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        period_s: float = PERIOD_S,
        turns_a_look: int = 1,
        may_wait: Callable[[], bool] = lambda: True,
    ) -> None:
        self._loop = loop
        self._period_s = period_s
        self._may_wait = may_wait
        self._turns_a_look = turns_a_look
        self._sockets: dict[int, _Socket] = {}
        self._watched: set[int] = set()
        self._found: Counter[int] = Counter()
        """Datagrams since the last turn."""
        self._has_gathered = False
        self._is_look = False
        """Whether the next turn is one that drains."""
        self._timer: asyncio.TimerHandle | None = None
        """Of the next turn; None while nothing arrives."""

    def add_reader(
        self, fd: int, drain: Drain, /, *, is_stamped: bool = True, is_deep: bool = False, gather: Drain | None = None
    ) -> None:
        """As `Readers` has it."""
        self._sockets[fd] = _Socket(drain, is_stamped, is_deep and is_stamped, gather)
        self._watch(fd)

    def remove_reader(self, fd: int, /) -> None:
        """As `Readers` has it."""
        self._ignore(fd)
        self._sockets.pop(fd, None)
        if not self._sockets and self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def read(self) -> None:
        """What waits now, for whoever needs the newest."""
        self._has_gathered = False
        for fd in list(self._sockets):
            self._drain(fd)

    def _woken(self, fd: int) -> None:
        one = self._sockets[fd]
        if self._timer is None:
            if self._may_wait():
                self._begin_turn(math.inf)
            self._drain(fd)
        elif not one.is_stamped:
            self._ignore(fd)
            self._drain(fd)
        elif one.is_deep:
            self._ignore(fd)  # it waits for the look; watched, it would wake us until then
        else:
            self._gather(fd)

    def _turn(self) -> None:
        may_wait = self._may_wait()
        if self._is_look or not may_wait:
            self.read()
        else:
            for fd in list(self._sockets):
                self._gather(fd)
        found, self._found = self._found, Counter()
        most, self._timer = max(found.values(), default=0), None
        if not may_wait:
            found.clear()
        elif (most or self._has_gathered) and self._sockets:
            self._begin_turn(0.0 if most >= AT_ONCE else self._period_s * _FEW / most if most > _FEW else math.inf)
        for fd, one in self._sockets.items():
            if (found[fd] and one.is_stamped) or (one.is_deep and self._timer is not None):
                self._ignore(fd)
            else:
                self._watch(fd)

    def _begin_turn(self, wait_s: float) -> None:
        """On the next beat of the loop's clock, which is the monotonic one, or before it. A timer may fire a little
        early."""
        now_s = self._loop.time()
        beat = math.floor((now_s + _EARLY_S) / self._period_s) + 1
        at_s = min(now_s + wait_s, beat * self._period_s)
        self._is_look = at_s == beat * self._period_s and beat % self._turns_a_look == 0
        self._timer = self._loop.call_at(at_s, self._turn)

    def _watch(self, fd: int) -> None:
        if fd not in self._watched:
            self._watched.add(fd)
            self._loop.add_reader(fd, self._woken, fd)

    def _ignore(self, fd: int) -> None:
        if fd in self._watched:
            self._watched.discard(fd)
            self._loop.remove_reader(fd)

    def _drain(self, fd: int) -> None:
        one = self._sockets.get(fd)  # one before it may have closed it
        if one is not None and one.gather is not None:
            self._take(fd, one.gather)
            self._call(one.drain)
        elif one is not None:
            self._take(fd, one.drain)

    def _gather(self, fd: int) -> None:
        """Between looks: no more than a socket cannot hold."""
        one = self._sockets.get(fd)
        if one is None or one.is_deep:
            return
        if one.gather is None:
            self._take(fd, one.drain)
        else:
            self._has_gathered |= self._take(fd, one.gather) > 0

    def _take(self, fd: int, drain: Drain) -> int:
        taken = self._call(drain)
        self._found[fd] += taken
        return taken

    def _call(self, drain: Drain) -> int:
        try:
            return drain()
        except Exception as error:  # noqa: BLE001 - one that fails is told as the loop tells it, and stops no other
            self._loop.call_exception_handler({"message": f"Exception in callback {drain!r}", "exception": error})
            return 0
