"""Reliability of an estimate, and the error that its own noise does not show."""

from __future__ import annotations

import math
from dataclasses import dataclass

_HALF, _SLOPE = 0.35, 0.1
_POSE_RAD = math.radians(1.0)
# Of the development runs, leaving out one position after the other, errors over deviations have unit mean square with
# 0.75 to 0.85; those that call themselves reliable need less.
_PULL = 0.75
# The share of such a field's phase that has the form of a curved wavefront: with it the ranges of the development runs
# have errors over deviations of unit mean square.
_BENT = 0.15
_LEAST_POWER = 0.01


@dataclass(frozen=True, slots=True)
class Evidence:
    """coherence sqrt(F) at the peak; rival, the highest other score relative to it; longest extent in wavelengths of
    the phase."""

    coherence: float
    rival: float
    length_wavelengths: float


def reliability(evidence: Evidence) -> float:
    """0..1, a logistic curve of coherence (1 - rival): 1/2 at 0.35, 0.8 at 0.49.

    Both factors fall where a second path is strong, poses drift, or packets are few; noise alone has 0.1 or less.
    """
    score = evidence.coherence * max(0.0, 1.0 - evidence.rival)
    return 1.0 / (1.0 + math.exp(-(score - _HALF) / _SLOPE))


def model_error_rad(evidence: Evidence) -> float:
    """Standard deviation on the sphere of what noise does not show: pose drift and second paths.

    The share 1 - F of the power that does not add up comes from fields of relative amplitude sqrt((1 - F) / F); such a
    field under the side of the main lobe, lambda / L wide, moves the peak by about its amplitude times that width. To
    this comes the heading of visual odometry, which drifts by about a degree while an aperture is flown.
    """
    moved = _PULL * _unexplained(evidence) / max(evidence.length_wavelengths, 1.0)
    return math.hypot(_POSE_RAD, moved)


def range_error_m(evidence: Evidence, variance_m2_per_rad2: float) -> float:
    """Standard deviation of the range of what noise does not show: the same fields bend the wavefront.

    `variance_m2_per_rad2` is the bound of the range for one rad^2 of phase over the whole aperture, that is for B bins
    B times its bound at a variance of 1 rad^2 each.
    """
    return _BENT * _unexplained(evidence) * math.sqrt(variance_m2_per_rad2)


def _unexplained(evidence: Evidence) -> float:
    """Amplitude of what does not add up, relative to what does."""
    power = min(max(evidence.coherence**2, _LEAST_POWER), 1.0)
    return math.sqrt((1 - power) / power)
