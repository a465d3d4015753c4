"""A bounded history of timed rows in one preallocated array, sliced without copying record by record."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


class History:
    """The newest `capacity` rows of `width` numbers, floats unless said,
    with their times [ns]. Appending is O(1); the oldest row goes first.

    Times must not go back: a row older than the newest is refused (`append` returns False) and counted.
    """

    def __init__(self, capacity: int, width: int, dtype: npt.DTypeLike = np.float64) -> None:
        # Twice the capacity, so that a slice of the newest rows is always contiguous; moved once per `capacity` rows.
        self._t_ns = np.zeros(2 * capacity, np.int64)
        self._rows: npt.NDArray[Any] = np.zeros((2 * capacity, width), dtype)
        self._capacity = capacity
        self._end = 0
        self.refused = 0

    def append(self, t_ns: int, row: npt.ArrayLike) -> bool:
        if self._end and t_ns < self._t_ns[self._end - 1]:
            self.refused += 1
            return False
        if self._end == len(self._t_ns):
            keep = slice(self._end - self._capacity, self._end)
            self._t_ns[: self._capacity] = self._t_ns[keep]
            self._rows[: self._capacity] = self._rows[keep]
            self._end = self._capacity
        self._t_ns[self._end] = t_ns
        self._rows[self._end] = row
        self._end += 1
        return True

    def between(self, start_ns: int, end_ns: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[Any]]:
        """Times (N,) and rows (N, width) from the last row at or before `start_ns` to the first at or after `end_ns`,
        so that both ends can be interpolated."""
        oldest = max(0, self._end - self._capacity)
        t_ns = self._t_ns[oldest : self._end]
        first = max(0, int(np.searchsorted(t_ns, start_ns, "right")) - 1)
        last = int(np.searchsorted(t_ns, end_ns, "left")) + 1
        rows = self._rows[oldest : self._end]
        return t_ns[first:last].copy(), rows[first:last].copy()

    @property
    def newest_ns(self) -> int | None:
        return int(self._t_ns[self._end - 1]) if self._end else None
