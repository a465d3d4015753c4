"""How likely what one aperture saw is, for a target at each of many places. The model is in docs/guidance.md.

An aperture sees several sources: the direct path and mirror images of it. Each path it found may be the direct one, the
reported one rather than the others; or none of them is.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.sensing.records import Bearing

Floats = npt.NDArray[np.floating[Any]]

_ACROSS_FLOOR_RAD: Final = math.radians(4.5)
"""Pose drift, and reflections that are not told apart: no bound on noise knows them."""
_DOWN_FLOOR_RAD: Final = math.radians(9.0)
"""Floor and ceiling mirror a source above and below itself: elevation is wrong more often, and by more."""
_REPORTED: Final = (0.45, 0.4)
"""Probability that the reported path is the direct one: at reliability 0, and what reliability 1 adds."""
_OTHERS: Final = 0.3
"""Of all other paths together."""
_CURVATURE_STD_PER_M: Final = 0.12
"""Of 1 / range beside its own deviation: over an aperture of 1.2 m a drift of the poses bends the wave front too."""
_RANGE_TRUSTED: Final = 0.8
_MOST_CURVATURE_PER_M: Final = 2.0
_UNSEEN: Final = (0.12, 0.6)
"""How often no range shows: from near, and from afar."""
_NEAR_M, _FAR_M = 2.5, 6.0
_LEAST_M: Final = 0.3


def likelihood(bearing: Bearing, offsets_m: Floats) -> Floats:
    """(N,) for targets at `offsets_m` (N, 3) from where the bearing was taken, per steradian."""
    flat_m = np.hypot(offsets_m[:, 0], offsets_m[:, 1])
    range_m = np.maximum(np.hypot(flat_m, offsets_m[:, 2]), _LEAST_M)
    azimuth = np.arctan2(offsets_m[:, 1], offsets_m[:, 0])
    polar = np.arctan2(flat_m, offsets_m[:, 2])
    sine = flat_m / range_m

    def seen(azimuth_rad: float, polar_rad: float) -> Floats:
        across = azimuth_rad - azimuth
        across -= math.tau * np.round(across / math.tau)
        # At the pole an azimuth means nothing: what it says across shrinks with the sine.
        across_std = np.hypot(sine * bearing.azimuth_std_rad, _ACROSS_FLOOR_RAD)
        result = np.exp(-0.5 * (sine * across / across_std) ** 2) / (across_std * math.sqrt(math.tau))
        if math.isinf(bearing.polar_std_rad):
            return np.asarray(result / math.pi)
        down_std = math.hypot(bearing.polar_std_rad, _DOWN_FLOOR_RAD)
        down = np.exp(-0.5 * ((polar_rad - polar) / down_std) ** 2) / (down_std * math.sqrt(math.tau))
        return np.asarray(result * down)

    reported = _REPORTED[0] + _REPORTED[1] * bearing.reliability
    total = reported * seen(bearing.azimuth_rad, bearing.polar_rad) * _ranged(bearing, range_m)
    power = sum(path.relative_power for path in bearing.others)
    nothing = 1.0 - reported
    for path in bearing.others:
        share = min(_OTHERS, nothing) * path.relative_power / max(power, 1.0)
        nothing -= share
        total += share * seen(path.azimuth_rad, path.polar_rad)
    return np.asarray(total + nothing / (4.0 * math.pi))


def _ranged(bearing: Bearing, range_m: Floats) -> Floats:
    """(N,) of the range of the reported path, or of there being none; 1 where it says nothing."""
    if bearing.range_m is None:
        share = np.clip((range_m - _NEAR_M) / (_FAR_M - _NEAR_M), 0.0, 1.0)
        return np.asarray((_UNSEEN[0] + (_UNSEEN[1] - _UNSEEN[0]) * share) / _UNSEEN[1])
    std = math.hypot(_CURVATURE_STD_PER_M, bearing.range_std_m / bearing.range_m**2)
    misfit = (1.0 / bearing.range_m - 1.0 / range_m) / std
    good = np.exp(-0.5 * misfit**2) / (std * math.sqrt(math.tau))
    # Relative to a curvature that may be anything.
    return np.asarray(_MOST_CURVATURE_PER_M * _RANGE_TRUSTED * good + (1.0 - _RANGE_TRUSTED))
