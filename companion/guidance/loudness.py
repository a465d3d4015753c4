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

_EXPONENT: Final = (1.5, 0.5)
"""Mean and deviation: 2 in the open, 1.3 where the direct path is 10 dB weaker."""
_LEVEL_STD_DB: Final = 15.0
"""Of c, about what was heard first."""
_SHADOWING_DB: Final = 4.0
"""Deviation of e over an aperture; from one to the next it is another."""
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
        places_m = np.array([heard.place_m for heard in self._heard])
        weight = np.array([heard.weight for heard in self._heard]) / _SHADOWING_DB**2
        power_db = np.array([heard.power_dbm for heard in self._heard])
        power_db = power_db - power_db[0]
        apart_m2 = _squared_distances(origins_m, places_m)
        fall_db = -5.0 * np.log10(np.maximum(apart_m2, _LEAST_M**2))  # of n = 1
        return _line_evidence(fall_db, power_db, weight)


def _squared_distances(a_m: Floats, b_m: Floats) -> Floats:
    """(N, K)"""
    parts = (np.subtract.outer(a_m[:, axis], b_m[:, axis]) ** 2 for axis in range(3))
    return np.asarray(sum(parts))


def _line_evidence(x: Floats, y: Floats, weight: Floats) -> Floats:
    """(N,) of y (K,) = c + n x (N, K) + noise of precision `weight` (K,), c and n integrated over their priors."""
    mean, std = _EXPONENT
    level = 1.0 / _LEVEL_STD_DB**2
    slope = 1.0 / std**2
    rest = y - mean * x
    w_x = weight * x
    a = level + float(weight.sum())
    b = w_x.sum(axis=1)
    c = slope + np.einsum("nk,nk->n", w_x, x)
    u = rest @ weight
    v = np.einsum("nk,nk->n", w_x, rest)
    determinant = a * c - b * b
    explained = (c * u * u - 2.0 * b * u * v + a * v * v) / determinant
    misfit = (rest * rest) @ weight - explained
    return np.asarray(-0.5 * (misfit + np.log(determinant)))
