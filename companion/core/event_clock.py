"""One input at a time, at one time: what makes a flight repeatable.

Everything that decides is called from the event loop by an input: bytes of the card, a pose, a datagram, a tick, a
person's wish, an answer of the worker, the outcome of a command. Each runs to its end before the next begins. While
one is handled the clock stands still, so that whoever asks reads the same time, and that time is all that the log needs
to hold.
"""

from __future__ import annotations

from companion.core.clock import Clock


class EventClock:
    """A `Clock` that stands still inside `event` and counts events; outside it is the clock below.

    For the event loop's thread only: other threads use the clock below.
    """

    def __init__(self, base: Clock) -> None:
        self._base = base
        self._held_ns: int | None = None
        self._number = 0

    @property
    def number(self) -> int:
        """Of the event in progress, or of the last one."""
        return self._number

    def count_from(self, number: int) -> None:
        """The next event has this number: of a log, parts may be missing."""
        self._number = number - 1

    @property
    def is_held(self) -> bool:
        """Whether an event is being handled."""
        return self._held_ns is not None

    def event(self, t_ns: int | None = None) -> EventSpan:
        """Handles one input at `t_ns` (now, if not given). Inside another event it is a part of that one."""
        return EventSpan(self, t_ns)

    def begin(self, t_ns: int | None = None) -> bool:
        """As `event`, to be ended by `end`; False inside another event, which goes on."""
        if self._held_ns is not None:
            return False
        self._number += 1
        self._held_ns = self._base.now_ns() if t_ns is None else t_ns
        return True

    def end(self) -> None:
        """The event that `begin` began."""
        self._held_ns = None

    def now_ns(self) -> int:
        return self._base.now_ns() if self._held_ns is None else self._held_ns

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        await self._base.sleep_until_ns(deadline_ns)


class EventSpan:
    """For `with`: an event of a clock, whose time it gives. No generator: there are 350 a second."""

    __slots__ = ("_begun", "_clock", "_t_ns")

    def __init__(self, clock: EventClock, t_ns: int | None) -> None:
        self._clock = clock
        self._t_ns = t_ns
        self._begun = False

    def __enter__(self) -> int:
        self._begun = self._clock.begin(self._t_ns)
        return self._clock.now_ns()

    def __exit__(self, *_: object) -> None:
        if self._begun:
            self._clock.end()
