"""Sources that a range has shown, whatever became of them: what a belief that has moved on would forget.

Of a robot and its mirror images behind walls the robot is the nearest to every place on its side of the walls, and the
flight began there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3

_Floats = npt.NDArray[np.float64]
_SPREAD_M: Final = 1.0
"""Sightings this near to each other are of one source."""
_APART_M: Final = 2.0
"""A source is another one from here on."""
_SEEN: Final = 0.5
"""Apertures' worth of packets that make a source count,"""
_SIDES: Final = math.cos(math.radians(25.0))
"""seen in directions that differ: their mean is no longer than this."""
_NEAR_M: Final = 2.5
"""From within this a range shows, in a hard room one time in four:"""
_MISSED: Final = 0.25
"""what a source loses of its weight in each aperture in which it might have been seen."""
_LEAST: Final = 1e-3
_MOST: Final = 64
"""Sources kept; the one that was seen least goes first."""


@dataclass(slots=True)
class _Source:
    """Sums over its sightings, each by its weight."""

    weight: float
    origin_m: _Floats
    unit: _Floats

    @property
    def mean_m(self) -> _Floats:
        return self.origin_m / self.weight

    @property
    def counts(self) -> bool:
        """A range that drifting poses feign lies ahead of the vehicle, on one side, wherever it is."""
        return self.weight >= _SEEN and float(np.linalg.norm(self.unit)) < _SIDES * self.weight


class Witnesses:
    """Takes sightings of sources, as origins of the target's frame. Levels count alone: heights are known too badly."""

    def __init__(self, began_m: _Floats) -> None:
        """`began_m` (3,): where the flight began, in the same frame as the origins."""
        self._began_m = began_m
        self._sources: list[_Source] = []

    def add(self, origin_m: _Floats, unit: _Floats, weight: float) -> None:
        """A source at `origin_m` (3,), seen in the direction `unit` (3,); `weight` in apertures' worth of packets."""
        if weight <= 0.0:
            return
        near = min(self._sources, key=lambda source: _level_m(source.mean_m, origin_m), default=None)
        if near is not None and _level_m(near.mean_m, origin_m) < _SPREAD_M:
            near.weight += weight
            near.origin_m = near.origin_m + weight * origin_m
            near.unit = near.unit + weight * unit
            return
        if len(self._sources) == _MOST:
            self._sources.remove(min(self._sources, key=lambda source: source.weight))
        self._sources.append(_Source(weight, weight * origin_m, weight * unit))

    def look(self, from_m: _Floats, weight: float) -> None:
        """From `from_m` (3,), in the same frame, sources near by might be seen; those that are not count less and less,
        or a flight would stay with one that drift has feigned."""
        for source in self._sources:
            if _level_m(source.mean_m, from_m) < _NEAR_M:
                kept = max(0.0, 1.0 - _MISSED * weight / source.weight)
                source.weight, source.origin_m, source.unit = (
                    kept * source.weight,
                    kept * source.origin_m,
                    kept * source.unit,
                )
        self._sources = [source for source in self._sources if source.weight > _LEAST]

    def shift(self, delta_m: _Floats) -> None:
        """All places are `delta_m` (3,) elsewhere."""
        self._began_m = self._began_m + delta_m
        for source in self._sources:
            source.origin_m = source.origin_m + source.weight * delta_m

    def nearer(self, origin_m: _Floats) -> Vector3 | None:
        """Of the sources that count, are not at `origin_m` (3,) and are nearer to where the flight began, the one that
        was seen most."""
        away_m = _level_m(origin_m, self._began_m)
        others = [
            source
            for source in self._sources
            if source.counts
            and _level_m(source.mean_m, origin_m) > _APART_M
            and _level_m(source.mean_m, self._began_m) < away_m
        ]
        best = max(others, key=lambda source: source.weight, default=None)
        if best is None:
            return None
        x, y, z = best.mean_m.tolist()
        return x, y, z


def _level_m(a_m: _Floats, b_m: _Floats) -> float:
    return math.hypot(a_m[0] - b_m[0], a_m[1] - b_m[1])
