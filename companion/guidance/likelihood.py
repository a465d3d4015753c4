"""How likely what one aperture saw is, for a target at each of many places. The model is in docs/guidance.md.

An aperture sees several sources: the direct path and mirror images of it. Each path it found may be the direct one, the
reported one rather than the others; or none of them is.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.guidance.regimes import REGIMES, Regime
from companion.sensing.records import Bearing
from wsr.geometry import direction

Floats = npt.NDArray[np.float64]

CURVATURE_STD_PER_M: Final = 0.09
_BENT_PER_M: Final = 1.7
"""Of 1 / range: over an aperture of 1.2 m a drift of the poses bends the wave front too, times its share of the way,"""
CURVATURE_SCALE: Final = 3.0
"""the more the flatter the aperture is, which a range's own deviation tells: so many times that is added."""
_MOST_CURVATURE_PER_M: Final = 2.0
"""Of a range that is not trusted, or another source's, 1 / range is anything up to here."""
_NEAR_M, _FAR_M = 2.5, 6.0
_LEAST_M: Final = 0.3
_SUREST: Final = 0.99
_OF_THE_REST: Final = 0.8
"""Other paths are the direct one, where the reported one is not, no more often than this."""
_AGAIN: Final = 0.8
"""What is reported and is not the direct path: so often it is the source of an aperture before,"""
_AGAIN_SHARPNESS: Final = math.radians(12.0) ** -2
"""about there. So an image that is seen again and again is no news where images are what is seen."""


def elsewhere(bearing: Bearing, before: Floats) -> float:
    """Density [1 / sr] of the reported direction where it is not the target's: there where earlier ones, `before`
    (J, 3), pointed, since what is louder stays louder for a while; or anywhere."""
    anywhere = 1.0 / (4.0 * math.pi)
    if not len(before):
        return anywhere
    cosine = np.einsum("jx,x->j", before, direction(bearing.azimuth_rad, bearing.polar_rad))
    again = np.mean(np.exp(_AGAIN_SHARPNESS * (cosine - 1.0))) * _AGAIN_SHARPNESS / math.tau
    return _AGAIN * float(again) + (1.0 - _AGAIN) * anywhere


def is_afar(range_m: Floats) -> Floats:
    """0 near a source, 1 where images of it are as loud as they get, and between."""
    return np.asarray(np.clip((range_m - _NEAR_M) / (_FAR_M - _NEAR_M), 0.0, 1.0))


def likelihoods(
    bearing: Bearing, azimuth: Floats, polar: Floats, range_m: Floats, *, elsewhere: float, drift: float
) -> Floats:
    """(K, N) in each kind of room for targets seen at `azimuth`, `polar` and `range_m` (N,) each, per steradian;
    `elsewhere` is the density of the reported path where it is not the target's. Poses drift by a share `drift` of the
    way."""
    range_m = np.maximum(range_m, _LEAST_M)
    return np.stack(
        [
            _likelihood(bearing, azimuth, polar, range_m, elsewhere=elsewhere, drift=drift, regime=regime)
            for regime in REGIMES
        ]
    )


def _likelihood(
    bearing: Bearing, azimuth: Floats, polar: Floats, range_m: Floats, *, elsewhere: float, drift: float, regime: Regime
) -> Floats:
    sine = np.sin(polar)
    # A drift shears the path, and with it the direction, by as much. At the pole an azimuth means nothing: what it says
    # across shrinks with the sine.
    across_std = np.hypot(sine * bearing.azimuth_std_rad, math.hypot(regime.across_std_rad, drift))
    down_std = math.hypot(bearing.polar_std_rad, regime.down_std_rad, drift)

    def seen(azimuth_rad: float, polar_rad: float) -> Floats:
        across = azimuth_rad - azimuth
        across -= math.tau * np.round(across / math.tau)
        misfit = (sine * across / across_std) ** 2
        if math.isinf(down_std):
            return np.asarray(np.exp(-0.5 * misfit) / (across_std * math.sqrt(math.tau) * math.pi))
        misfit += ((polar_rad - polar) / down_std) ** 2
        return np.asarray(np.exp(-0.5 * misfit) / (across_std * down_std * math.tau))

    afar = is_afar(range_m)
    near, far, more = regime.reported
    reported = np.minimum(near + (far - near) * afar + more * bearing.reliability, _SUREST)
    total = (
        reported * seen(bearing.azimuth_rad, bearing.polar_rad) * _ranged(bearing, range_m, afar, drift, regime=regime)
    )
    power = sum(path.relative_power for path in bearing.others)
    missed = 1.0 - reported
    if power > 0.0:
        others = np.minimum(regime.others, _OF_THE_REST * missed) / max(power, 1.0)
        found = sum(path.relative_power * seen(path.azimuth_rad, path.polar_rad) for path in bearing.others)
        total += _ranged_afar(bearing, regime) * others * found
        missed = missed - others * power
    total += _ranged_afar(bearing, regime) * missed * elsewhere
    mean = regime.reliability
    told = math.exp(-bearing.reliability / mean) / (mean * -math.expm1(-1.0 / mean))
    return np.asarray(told * total)


def _ranged(bearing: Bearing, range_m: Floats, afar: Floats, drift: float, *, regime: Regime) -> Floats:
    """(N,) of the range of the reported path, per 1/m, or of there being none."""
    near, far = regime.unseen
    unseen = near + (far - near) * afar
    if bearing.range_m is None:
        return np.asarray(unseen)
    std = math.hypot(
        CURVATURE_STD_PER_M, _BENT_PER_M * drift, CURVATURE_SCALE * bearing.range_std_m / bearing.range_m**2
    )
    misfit = (1.0 / bearing.range_m - 1.0 / range_m) / std
    good = np.exp(-0.5 * misfit**2) / (std * math.sqrt(math.tau))
    return np.asarray((1.0 - unseen) * (regime.trusted * good + (1.0 - regime.trusted) / _MOST_CURVATURE_PER_M))


def _ranged_afar(bearing: Bearing, regime: Regime) -> float:
    """The same where the reported path is another source's."""
    return regime.unseen[1] if bearing.range_m is None else (1.0 - regime.unseen[1]) / _MOST_CURVATURE_PER_M
