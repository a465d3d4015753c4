"""Received power -> how likely places of the target are.

Power falls with distance: P = c - 10 n log10(d) + e. What the cards and antennas make of it, c, is not known; the
exponent n is nearly that of free space where the direct path is alone and smaller among echoes; e is shadowing. Both
constants are integrated out, which leaves for each place how well a line through (log distance, power) explains the
flight so far: the evidence of a Bayesian linear regression (Bishop, Pattern Recognition and Machine Learning, 3.5.1).
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]

_EXPONENT: Final = (1.5, 0.5)
"""Mean and deviation: 2 in the open, 1.3 where the direct path is 10 dB weaker."""
_LEVEL_STD_DB: Final = 15.0
"""Of c, about what was heard first."""
_SHADOWING_DB: Final = 4.0
"""Deviation of e over an aperture,"""
_ALIKE: Final = 2.5
"""and over so many it is the same: indoors it is another one after some 3 m of path (Gudmundson, Correlation model for
shadow fading, 1991). Taken for another in each, it looks like a source that is passed."""
_LEAST_M: Final = 0.7
"""Antennas that are nearer than this hear each other by their patterns' nulls."""
_GROUPED: Final = 1.0
"""Apertures' worth of packets that make one record,"""
_MOST: Final = 32
"""and how many of the newest are kept."""


class PowerHeard(NamedTuple):
    """Mean place (3,) and power [dBm] over `weight` apertures' worth of packets."""

    place_m: Floats
    power_dbm: float
    weight: float


class Loudness:
    """Takes received powers with the places they were heard at."""

    def __init__(self) -> None:
        self._heard: deque[PowerHeard] = deque(maxlen=_MOST)

    def add(self, place_m: Floats, power_dbm: float, weight: float) -> None:
        """At `place_m` (3,), relative to the target's motion; `weight` in apertures' worth of packets."""
        if weight <= 0.0 or not math.isfinite(power_dbm):
            return
        if not self._heard or self._heard[-1].weight >= _GROUPED:
            self._heard.append(PowerHeard(place_m, power_dbm, weight))
            return
        last = self._heard[-1]
        total = last.weight + weight
        self._heard[-1] = PowerHeard(
            (last.weight * last.place_m + weight * place_m) / total,
            (last.weight * last.power_dbm + weight * power_dbm) / total,
            total,
        )

    def shift(self, delta_m: Floats) -> None:
        """All places are `delta_m` (3,) elsewhere."""
        self._heard = deque((heard._replace(place_m=heard.place_m + delta_m) for heard in self._heard), _MOST)

    def evidence(self, origins_m: Floats) -> Floats:
        """(N,) logarithm of the likelihood of all powers for targets at `origins_m` (N, 3), up to a constant."""
        if len(self._heard) < 2:
            return np.zeros(len(origins_m))
        # float32, places along the rows: of the logarithms of thousands of distances a hundredth of a decibel counts.
        places_m = np.array([heard.place_m for heard in self._heard], np.float32)
        weight = np.array([heard.weight for heard in self._heard]) / (_ALIKE * _SHADOWING_DB**2)
        power_db = np.array([heard.power_dbm for heard in self._heard])
        apart_m2 = _squared_distances(places_m, origins_m.astype(np.float32))
        fall_db = np.log(np.maximum(apart_m2, np.float32(_LEAST_M**2))) * np.float32(-5.0 / math.log(10.0))  # of n = 1
        return _line_evidence(fall_db, power_db - power_db[0], weight)


def _squared_distances(a_m: Singles, b_m: Singles) -> Singles:
    """(K, N) of places (K, 3) and (N, 3)."""
    parts = (np.subtract.outer(a_m[:, axis], np.ascontiguousarray(b_m[:, axis])) ** 2 for axis in range(3))
    return np.asarray(sum(parts))


def _line_evidence(x: Singles, y: Floats, weight: Floats) -> Floats:
    """(N,) of y (K,) = c + n x (K, N) + noise of precision `weight` (K,), c and n integrated over their priors."""
    mean, std = _EXPONENT
    level = 1.0 / _LEVEL_STD_DB**2
    slope = 1.0 / std**2
    w_x = weight.astype(np.float32)[:, None] * x
    b = w_x.sum(axis=0, dtype=np.float64)
    xx = np.einsum("kn,kn->n", w_x, x).astype(np.float64)
    xy = np.einsum("kn,k->n", w_x, y.astype(np.float32)).astype(np.float64)
    # Of what the mean slope leaves of y.
    u = float(weight @ y) - mean * b
    v = xy - mean * xx
    misfit = float(weight @ (y * y)) - 2.0 * mean * xy + mean**2 * xx
    a = level + float(weight.sum())
    c = slope + xx
    determinant = a * c - b * b
    misfit -= (c * u * u - 2.0 * b * u * v + a * v * v) / determinant
    return np.asarray(-0.5 * (misfit + np.log(determinant)))
