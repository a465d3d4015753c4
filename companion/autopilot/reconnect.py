"""How long to wait before a connection is tried again, and how loudly a failure is told."""

from __future__ import annotations

import logging
from typing import Final

_FIRST_S: Final = 0.5
_LONGEST_S: Final = 8.0


class Backoff:
    """Each failure waits twice as long as the one before, up to a cap. The first is a warning, repeats are debug."""

    def __init__(self) -> None:
        self._wait_s = _FIRST_S
        self.failures = 0

    @property
    def level(self) -> int:
        """Of the log line of the failure that has just happened."""
        return logging.DEBUG if self.failures else logging.WARNING

    def next_s(self) -> float:
        """One more failure: how long to wait now."""
        wait_s, self._wait_s = self._wait_s, min(2 * self._wait_s, _LONGEST_S)
        self.failures += 1
        return wait_s
