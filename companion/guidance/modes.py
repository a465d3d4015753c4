"""Which of the weighted places of a belief are one source: those around the densest one."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]

_MODE_RAD: Final = math.radians(20.0)
_MODE_RATIO: Final = 2.0
"""Particles within this angle and this ratio of ranges from the densest one are one source."""
_SAMPLED: Final = 250


def densest(offsets_m: _Floats, weight: _Floats) -> npt.NDArray[np.intp]:
    """Indices of the places around the densest one, of weights (N,), at `offsets_m` (N, 3) from where they are seen."""
    range_m = np.maximum(np.linalg.norm(offsets_m, axis=1), 1e-3)
    units, log_range = offsets_m / range_m[:, None], np.log(range_m)
    picks = systematic(weight / weight.sum(), _SAMPLED)
    best = picks[int(np.argmax(_neighbours(units[picks], log_range[picks])))]
    inside = (
        (units @ units[best] > math.cos(_MODE_RAD))
        & (np.abs(log_range - log_range[best]) < math.log(_MODE_RATIO))
        & (weight > 0)
    )
    return np.flatnonzero(inside)


def normalised(log_weight: _Floats) -> _Floats:
    """Logarithms of weights (N,) that come to one."""
    log_weight = log_weight - log_weight.max()
    return np.asarray(log_weight - math.log(float(np.exp(log_weight).sum())))


def systematic(probability: _Floats, count: int) -> npt.NDArray[np.intp]:
    """Indices (count,) of a systematic sample of places with probabilities (N,)."""
    at = (np.arange(count) + 0.5) / count
    return np.minimum(np.searchsorted(np.cumsum(probability), at), len(probability) - 1)


def _neighbours(units: _Floats, log_range: _Floats) -> npt.NDArray[np.intp]:
    """(N,) how many of the places in directions (N, 3) at ranges (N,) are near each one of them."""
    # Not by BLAS, whose threads spin: this runs in the process of the control loop. float32, so that it stays in cache.
    x, y, z = np.ascontiguousarray(units.T, np.float32)
    height = log_range.astype(np.float32)
    cosine = np.multiply.outer(x, x)
    table = np.multiply.outer(y, y)
    cosine += table
    cosine += np.multiply.outer(z, z, out=table)
    near = cosine > np.float32(math.cos(_MODE_RAD))
    np.abs(np.subtract.outer(height, height, out=table), out=table)
    near &= table < np.float32(math.log(_MODE_RATIO))
    return np.asarray(near.view(np.uint8).sum(axis=1, dtype=np.intp))
