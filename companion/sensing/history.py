"""A bounded history of timed rows in one preallocated array, sliced without copying record by record."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

_GATHERED: Final = 128


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
        self._newest_ns: int | None = None
        # Rows come one by one at 200 Hz, and to put one into an array costs as much as to put in twenty.
        self._new_t_ns: list[int] = []
        self._new_rows: list[npt.ArrayLike] = []
        self._most_new = min(_GATHERED, capacity)
        self.refused = 0

    def append(self, t_ns: int, row: npt.ArrayLike) -> bool:
        """`row` is not to be changed afterwards."""
        if self._newest_ns is not None and t_ns < self._newest_ns:
            self.refused += 1
            return False
        self._newest_ns = t_ns
        self._new_t_ns.append(t_ns)
        self._new_rows.append(row)
        if len(self._new_rows) == self._most_new:
            self._take_new()
        return True

    def between(self, start_ns: int, end_ns: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[Any]]:
        """Times (N,) and rows (N, width) from the last row at or before `start_ns` to the first at or after `end_ns`,
        so that both ends can be interpolated."""
        self._take_new()
        oldest = max(0, self._end - self._capacity)
        t_ns = self._t_ns[oldest : self._end]
        first = max(0, int(np.searchsorted(t_ns, start_ns, "right")) - 1)
        last = int(np.searchsorted(t_ns, end_ns, "left")) + 1
        rows = self._rows[oldest : self._end]
        return t_ns[first:last].copy(), rows[first:last].copy()

    @property
    def newest_ns(self) -> int | None:
        return self._newest_ns

    def _take_new(self) -> None:
        if not self._new_rows:
            return
        if self._end + len(self._new_rows) > len(self._t_ns):
            keep = slice(self._end - self._capacity, self._end)
            self._t_ns[: self._capacity] = self._t_ns[keep]
            self._rows[: self._capacity] = self._rows[keep]
            self._end = self._capacity
        end = self._end + len(self._new_rows)
        self._t_ns[self._end : end] = self._new_t_ns
        self._rows[self._end : end] = self._new_rows
        self._end = end
        self._new_t_ns.clear()
        self._new_rows.clear()
