"""The newest lines of sight to a target, and where another one passes them."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]

_KEPT: Final = 20
_PARALLEL: Final = math.cos(math.radians(7.0))
_STD: Final = 0.2
"""Of the ratio by which a range is off where two pass each other: both are vague."""


class Crossings:
    def __init__(self) -> None:
        self._lines = deque[tuple[_Floats, _Floats]](maxlen=_KEPT)
        """Place (3,) and direction (3,)."""

    def add(self, place_m: _Floats, unit: _Floats) -> None:
        self._lines.append((place_m, unit))

    def clear(self) -> None:
        self._lines.clear()

    def shift(self, delta_m: _Floats) -> None:
        """All places are `delta_m` (3,) elsewhere."""
        self._lines = deque(((place_m + delta_m, unit) for place_m, unit in self._lines), _KEPT)

    def directions(self) -> _Floats:
        """(N, 3) of those kept."""
        return np.array([unit for _, unit in self._lines])

    def ranges_m(
        self,
        place_m: _Floats,
        units: _Floats,
        otherwise_m: _Floats,
        reach_m: tuple[float, float],
        rng: np.random.Generator,
    ) -> _Floats:
        """(M,) from a place (3,) along directions (M, 3) to where each passes one of the lines, drawn for it; where the
        two are nearly parallel, or it would be out of reach, `otherwise_m` (M,)."""
        if not self._lines:
            return otherwise_m
        which = rng.integers(len(self._lines), size=len(units))
        from_m, along = (np.array([line[k] for line in self._lines])[which] for k in (0, 1))
        apart_m = place_m - from_m
        cosine, own, other = ((a * b).sum(axis=1) for a, b in ((units, along), (units, apart_m), (along, apart_m)))
        range_m = (cosine * other - own) / np.maximum(1.0 - cosine**2, 1e-9)
        range_m *= np.exp(rng.normal(0.0, _STD, len(units)))
        crosses = (np.abs(cosine) < _PARALLEL) & (range_m > reach_m[0]) & (range_m < reach_m[1])
        return np.where(crosses, range_m, otherwise_m)
