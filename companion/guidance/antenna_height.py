"""How high above the ground the target's antenna may be: as configured, or at least not below it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_STD_M: Final = 0.2
"""Of a height that is configured: floors are not even, and a vehicle's height is its estimator's."""
_BELOW_GROUND_M: Final = (0.2, 0.25)
"""Targets stand on the ground the vehicle took off from, or above it: by so much below it they become unlikely."""
_HIGH_M: Final = 2.0
"""Before anything is seen a target that much higher is less likely by e: a ceiling mirrors one on the floor far up."""


class AntennaHeight:
    """What heights say of places of the target. All are above the ground; 0 where that is not known."""

    def __init__(self, expected_m: float | None) -> None:
        """`expected_m` is the antenna's, of a robot that stands on the ground; None where nobody says."""
        self._expected_m = expected_m
        self.begin_anew()

    def begin_anew(self) -> None:
        """Nothing has drifted yet."""
        self._variance_m2 = _STD_M**2

    @property
    def is_expected(self) -> bool:
        return self._expected_m is not None

    def wander(self, std_m: float) -> None:
        """The vehicle's and the target's heights have drifted apart by so much more."""
        self._variance_m2 += std_m**2

    def expected_m(self, rng: np.random.Generator, count: int) -> Floats | None:
        """(count,) drawn heights; None where none is expected."""
        if self._expected_m is None:
            return None
        return np.asarray(rng.normal(self._expected_m, math.sqrt(self._variance_m2), count))

    def log_prior(self, height_m: Floats) -> Floats:
        """(N,) of targets so high, before anything is seen, up to a constant."""
        if self._expected_m is None:
            return np.asarray(-height_m.clip(0.0) / _HIGH_M)
        return np.asarray(-0.5 * (height_m - self._expected_m) ** 2 / self._variance_m2)

    def log_seen_again(self, height_m: Floats, fresh: float, told: Floats) -> Floats:
        """(N,) what heights say after so many apertures more, where places have changed a little: `told` (N,) is the
        prior that counts already."""
        if self._expected_m is None:
            margin_m, scale_m = _BELOW_GROUND_M
            return np.asarray(-fresh * np.maximum(0.0, -(height_m + margin_m) / scale_m))
        return self.log_prior(height_m) - told
