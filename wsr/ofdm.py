"""The subcarriers of a channel: where they lie, and which of them are neighbours.

Steps that estimate a delay compare subcarriers a fixed lag apart, 625 kHz or as near to it as the grid has: by it
delays are told apart up to 1.6 us, which is more than rooms and cards have together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

UNIT_HZ: Final = 312_500.0
"""What indices count in, on every grid: the spacing of 802.11n."""
LAG: Final = 2.0
"""Lag that is wanted, in these units."""
INDICES_5300_20MHZ: Final[NDArray[np.int64]] = np.array([*range(-28, 0, 2), -1, *range(1, 28, 2), 28], np.int64)
"""Indices (30,) of the subcarriers an Intel 5300 reports at 20 MHz: steps of two, but of one at -1 and 28."""

_NEARLY = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Subcarriers (S,), lowest frequency first. Make with `grid`."""

    k: NDArray[np.float64]
    """Frequencies from the channel's centre, in units of 312.5 kHz."""
    step: int
    """Positions from a subcarrier to the one it is compared with."""
    lag: float
    """Their distance, in the units of `k`: 2, or nearly so, on all grids of WiFi."""
    first: NDArray[np.intp]
    """Positions (P,) of those whose `step`-th next is a `lag` away; empty of a single subcarrier."""

    @property
    def size(self) -> int:
        return int(self.k.size)

    @property
    def hz(self) -> NDArray[np.float64]:
        return self.k * UNIT_HZ

    @property
    def second(self) -> NDArray[np.intp]:
        """The other end of each pair."""
        return self.first + self.step

    @property
    def bandwidth_hz(self) -> float:
        return float(self.k[-1] - self.k[0]) * UNIT_HZ


def grid(subcarrier_hz: ArrayLike) -> Grid:
    """The grid of frequencies (S,) from the channel's centre, rising. Raises ValueError for any other."""
    hz = np.asarray(subcarrier_hz, np.float64)
    if hz.ndim != 1 or hz.size == 0 or not np.isfinite(hz).all() or np.any(np.diff(hz) <= 0):
        raise ValueError(f"subcarriers of shape {hz.shape}; expected frequencies (S,) that rise")
    return _grid(hz.tobytes())


@lru_cache(maxsize=32)
def _grid(frequencies: bytes) -> Grid:
    k = np.frombuffer(frequencies, np.float64) / UNIT_HZ
    best: tuple[float, int, float] | None = None
    for step in range(1, k.size):
        apart = k[step:] - k[:-step]
        # The median, for which numpy imports its masked arrays: 40 ms of each start of any process.
        in_order = np.sort(apart)
        usual = float(in_order[(apart.size - 1) // 2] + in_order[apart.size // 2]) / 2.0
        off = abs(usual - LAG)
        if best is None or off < best[0] - _NEARLY:
            best = off, step, usual
        elif usual > LAG:
            break
    _, step, lag = best or (0.0, 1, LAG)
    first = np.flatnonzero(np.abs(k[step:] - k[:-step] - lag) < _NEARLY)
    first.flags.writeable = False
    return Grid(k, step, lag, first)


GRID_5300: Final = grid(INDICES_5300_20MHZ * UNIT_HZ)


def known(subcarriers: int, given: Grid | None = None) -> Grid:
    """The grid of a channel of so many subcarriers: the given one; else of 30 the 5300's, and one alone is the centre.
    Raises ValueError where they do not fit."""
    if given is None and subcarriers in (1, GRID_5300.size):
        return GRID_5300 if subcarriers > 1 else _CENTRE
    if given is None or given.size != subcarriers:
        said = "their frequencies are not given" if given is None else f"frequencies of {given.size} are given"
        raise ValueError(f"channel of {subcarriers} subcarriers; {said}")
    return given


_CENTRE: Final = grid([0.0])
