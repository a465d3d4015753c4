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
_SHOWS: Final = 2.0
_LEAST_PER_M: Final = 1.0 / 60.0
"""A range is told where 1 / range is so many of its own deviations, and at least so much."""
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
    if math.isinf(bearing.polar_std_rad):
        cosine = np.cos(np.arctan2(before[:, 1], before[:, 0]) - bearing.azimuth_rad)
        most = 0.5 * math.sqrt(_AGAIN_SHARPNESS / math.tau)
    else:
        cosine = np.einsum("jx,x->j", before, direction(bearing.azimuth_rad, bearing.polar_rad))
        most = _AGAIN_SHARPNESS / math.tau
    again = most * np.mean(np.exp(_AGAIN_SHARPNESS * (cosine - 1.0)))
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
    sine = np.sin(polar)
    paths = [(path.azimuth_rad, path.polar_rad) for path in bearing.others]
    misses = [
        _miss(*path, azimuth=azimuth, polar=polar, sine=sine)
        for path in [(bearing.azimuth_rad, bearing.polar_rad), *paths]
    ]
    shown = _shown(bearing, range_m, drift)
    afar = is_afar(range_m)
    return np.stack(
        [
            _likelihood(bearing, sine, misses, shown, afar=afar, elsewhere=elsewhere, drift=drift, regime=regime)
            for regime in REGIMES
        ]
    )


def _miss(at: float, down: float, *, azimuth: Floats, polar: Floats, sine: Floats) -> tuple[Floats, Floats]:
    """(N,) squares of the angles across and down between a path and where targets are seen. At the pole an azimuth
    means nothing: what it says across shrinks with the sine."""
    across = at - azimuth
    across -= math.tau * np.round(across / math.tau)
    return (sine * across) ** 2, (down - polar) ** 2


def _likelihood(
    bearing: Bearing,
    sine: Floats,
    misses: list[tuple[Floats, Floats]],
    shown: Floats | None,
    *,
    afar: Floats,
    elsewhere: float,
    drift: float,
    regime: Regime,
) -> Floats:
    # A drift shears the path, and with it the direction, by as much.
    across_var = (sine * bearing.azimuth_std_rad) ** 2 + (regime.across_std_rad**2 + drift**2)
    down_var = bearing.polar_std_rad**2 + regime.down_std_rad**2 + drift**2
    level = math.isinf(down_var)
    scale = _of_azimuth(np.sqrt(across_var), sine) if level else 1.0 / (math.tau * np.sqrt(across_var * down_var))

    def seen(miss: tuple[Floats, Floats]) -> Floats:
        misfit = miss[0] / across_var
        if not level:
            misfit += miss[1] / down_var
        return np.asarray(scale * np.exp(-0.5 * misfit))

    near, far, more = regime.reported
    reported = np.minimum(near + (far - near) * afar + more * bearing.reliability, _SUREST)
    total = reported * seen(misses[0]) * _ranged(shown, afar, regime)
    power = sum(path.relative_power for path in bearing.others)
    missed = 1.0 - reported
    if power > 0.0:
        others = np.minimum(regime.others, _OF_THE_REST * missed) / max(power, 1.0)
        found = sum(path.relative_power * seen(miss) for path, miss in zip(bearing.others, misses[1:], strict=True))
        total += _ranged_afar(bearing, regime) * others * found
        missed = missed - others * power
    total += _ranged_afar(bearing, regime) * missed * elsewhere
    mean = regime.reliability
    told = math.exp(-bearing.reliability / mean) / (mean * -math.expm1(-1.0 / mean))
    return np.asarray(told * total)


def _of_azimuth(across_std: Floats, sine: Floats) -> Floats:
    """(N,) density [1 / sr] at the azimuth where a target is seen, of a bearing that tells no height: what is right
    above or below has any azimuth."""
    std = across_std / np.maximum(sine, 1e-6)
    return np.asarray(0.5 / (math.sqrt(math.tau) * std * (2.0 * _below(math.pi / std) - 1.0)))


def _shown(bearing: Bearing, range_m: Floats, drift: float) -> Floats | None:
    """(N,) density of the range of the reported path, per 1/m, if it is the target's and shows; None where none does.

    A curvature that shows is one above what noise makes of none: of a far target only those show that seem nearer."""
    if bearing.range_m is None:
        return None
    own = bearing.range_std_m / bearing.range_m**2
    std = math.hypot(CURVATURE_STD_PER_M, _BENT_PER_M * drift, CURVATURE_SCALE * own)
    true_per_m = 1.0 / range_m
    misfit = (1.0 / bearing.range_m - true_per_m) / std
    least = max(_SHOWS * own, _LEAST_PER_M)
    return np.asarray(np.exp(-0.5 * misfit**2) / (std * math.sqrt(math.tau)) / _below((true_per_m - least) / std))


def _below(x: Floats) -> Floats:
    """(N,) of the normal distribution below x, to 0.00014 (Bowling et al., J. Ind. Eng. Manag. 2, 2009)."""
    return np.asarray(1.0 / (1.0 + np.exp(-x * (1.5976 + 0.07056 * x * x))))


def _ranged(shown: Floats | None, afar: Floats, regime: Regime) -> Floats:
    """(N,) of the range of the reported path, per 1/m, or of there being none."""
    near, far = regime.unseen
    unseen = near + (far - near) * afar
    if shown is None:
        return np.asarray(unseen)
    return np.asarray((1.0 - unseen) * (regime.trusted * shown + (1.0 - regime.trusted) / _MOST_CURVATURE_PER_M))


def _ranged_afar(bearing: Bearing, regime: Regime) -> float:
    """The same where the reported path is another source's."""
    return regime.unseen[1] if bearing.range_m is None else (1.0 - regime.unseen[1]) / _MOST_CURVATURE_PER_M
