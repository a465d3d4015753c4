"""Reads a log ahead while the replay waits for the AOA worker: reading costs a quarter of the time of all the rest."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

from companion.log.reader import LoggedMessage

_MOST: Final = 32768
_AT_ONCE: Final = 64
"""Takes about 2 ms, the longest that an answer lies unread."""


class ReadAhead(Iterator[LoggedMessage]):
    """The same messages in the same order; `fill` is called whenever there is nothing else to do."""

    def __init__(self, messages: Iterable[LoggedMessage]) -> None:
        self._rest = iter(messages)
        self._waiting: deque[LoggedMessage] = deque()

    def __next__(self) -> LoggedMessage:
        return self._waiting.popleft() if self._waiting else next(self._rest)

    def fill(self) -> bool:
        """Reads some; whether there may be more to read, and room for it."""
        before = len(self._waiting)
        if before < _MOST:
            self._waiting.extend(islice(self._rest, _AT_ONCE))
        return len(self._waiting) - before == _AT_ONCE
