"""Angle of arrival: what an estimate says about itself, and the protocol of what makes one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from wsr.aperture import Aperture
from wsr.directions import Peak, Profile

Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class Cone:
    """What a straight path tells: the source is on this cone about the unit vector `axis` (ENU), `angle_rad` from it,
    within its standard deviation; where on the cone is open."""

    axis: tuple[float, float, float]
    angle_rad: float
    angle_std_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AoaEstimate:
    """Direction from `reference_p_m` (ENU) at `reference_t_s` to the transmitter, azimuth in [-pi, pi), and its range.

    `covariance` (3, 3) is of (azimuth, polar angle, range) in rad and m, infinite on the diagonal where the geometry
    determines nothing (and zero beside it); the deviations are its roots. `crb_rad` is the bound at the noise seen,
    with an unknown phase, as a great circle; it knows neither of pose errors nor of a second path, the covariance may.
    `coherence` is sqrt(power) of the peak. `reliability` (0..1) falls with rival peaks and poor coherence.

    What is not `observable` may be anything; `range_m` is None then. `alternatives` are the directions that this
    aperture cannot tell from the reported one: the mirror image of a planar one; of a straight one the twin on its
    other side first and then some more of its `cone`, which is None for other apertures. `paths` are those found, the
    reported one first.

    `drift_turns` of phase over the aperture were taken out as a velocity error of the poses; 0 where none was found.

    `packets` were used, `dropped` counts the others by reason. The reference point is the mean position of the
    packets, as the estimator weighs them: `Aperture.reference_p_m` plus the weighted mean of chi. So the point in any
    other frame is that frame's mean over the packets, plus (reference_p_m - aperture.reference_p_m).
    """

    azimuth_rad: float
    polar_rad: float
    azimuth_std_rad: float
    polar_std_rad: float
    covariance: Matrix3
    crb_rad: float
    coherence: float
    reliability: float
    azimuth_observable: bool
    polar_observable: bool
    alternatives: tuple[Peak, ...]
    packets: int
    length_m: float
    extents_m: tuple[float, float, float]
    reference_p_m: tuple[float, float, float]
    reference_t_s: float
    range_m: float | None = None
    range_std_m: float = math.inf
    range_observable: bool = False
    paths: tuple[Peak, ...] = ()
    dropped: Mapping[str, int] = field(default_factory=dict)
    drift_turns: float = 0.0
    cone: Cone | None = None


class Estimator(Protocol):
    """Anything that makes a direction of an aperture; pure, and deterministic for the same aperture."""

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and the profile it was read from. Raises ApertureError."""
