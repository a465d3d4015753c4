"""Which of the weighted places of a belief are one source: those around the densest one."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]

_MODE_COSINE: Final = math.cos(math.radians(20.0))
_MODE_RATIO: Final = 2.0
"""Particles within this angle and this ratio of ranges from where they are densest are one source."""
_SAMPLED: Final = 250
"""Places among which the densest is looked for, from which is climbed"""
_CLIMBS: Final = 15
"""so often, among the places"""
_AROUND_COSINE, _AROUND = math.cos(math.radians(40.0)), 2.0
"""in these directions and within the ratio to this power."""


def densest(offsets_m: _Floats, weight: _Floats) -> npt.NDArray[np.intp]:
    """Indices of the places around the densest one, of weights (N,), at `offsets_m` (N, 3) from where they are seen.

    Where that is follows smoothly from the places: a count of neighbours has ties, and which place then is the densest
    would follow from how a processor rounds.
    """
    range_m = np.maximum(np.linalg.norm(offsets_m, axis=1), 1e-3)
    units, height = offsets_m / range_m[:, None], np.log(range_m) / math.log(_MODE_RATIO)
    picks = systematic(weight / weight.sum(), _SAMPLED)
    best = picks[int(np.argmax(_density(units[picks], height[picks])))]
    along, up = _climbed(units, height, weight, int(best))
    inside = (units @ along > _MODE_COSINE) & (np.abs(height - up) < 1.0) & (weight > 0)
    return np.flatnonzero(inside)


def _climbed(units: _Floats, height: _Floats, weight: _Floats, start: int) -> tuple[_Floats, float]:
    """From one of the places up to where they are densest (mean shift: Comaniciu and Meer 2002)."""
    along, up = units[start], float(height[start])
    around = np.flatnonzero((units @ along > _AROUND_COSINE) & (np.abs(height - up) < _AROUND))
    units, height, weight = units[around], height[around], weight[around]
    for _ in range(_CLIMBS):
        share = weight * np.maximum(units @ along - _MODE_COSINE, 0.0) * np.maximum(1.0 - (height - up) ** 2, 0.0)
        share /= share.sum()
        along, up = share @ units, float(share @ height)
        along = along / math.sqrt(float(along @ along))
    return along, up


def normalised(log_weight: _Floats) -> _Floats:
    """Logarithms of weights (N,) that come to one."""
    log_weight = log_weight - log_weight.max()
    return np.asarray(log_weight - math.log(float(np.exp(log_weight).sum())))


def systematic(probability: _Floats, count: int) -> npt.NDArray[np.intp]:
    """Indices (count,) of a systematic sample of places with probabilities (N,)."""
    at = (np.arange(count) + 0.5) / count
    return np.minimum(np.searchsorted(np.cumsum(probability), at), len(probability) - 1)


def _density(units: _Floats, height: _Floats) -> npt.NDArray[np.float32]:
    """(N,) of the places in directions (N, 3) at ranges (N,) in powers of the ratio: of each one how many others there
    are near it, the nearer the more (Epanechnikov's kernel in angle and in range)."""
    # Not by BLAS, whose threads spin: this runs in the process of the control loop. float32, so that it stays in cache.
    x, y, z = np.ascontiguousarray(units.T, np.float32)
    up = height.astype(np.float32)
    near = np.multiply.outer(x, x)
    table = np.multiply.outer(y, y)
    near += table
    near += np.multiply.outer(z, z, out=table)
    near -= np.float32(_MODE_COSINE)
    np.maximum(near, 0.0, out=near)
    np.square(np.subtract.outer(up, up, out=table), out=table)
    np.subtract(1.0, table, out=table)
    near *= np.maximum(table, 0.0, out=table)
    return np.asarray(near.sum(axis=1))
