"""Angle of arrival: what an estimate says about itself, and what makes one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wsr.aperture import Aperture
from wsr.crb import Crb, crb
from wsr.geometry import direction, wrap_angle
from wsr.peaks import Peak
from wsr.profile import Profile
from wsr.uncertainty import phase_variance, time_correlation

# A plane within this tilt of the horizon is "horizontal": it decides which of two mirror images is reported.
_HORIZONTAL_RAD = math.radians(30.0)
# An angle is observable when its bound is below this and both mirror images agree on it as closely.
_OBSERVABLE_RAD = math.radians(10.0)

Array = NDArray[np.float64]
Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class AoaEstimate:
    """Direction from `reference_p_m` (ENU) at `reference_t_s` to the transmitter, azimuth in [-pi, pi), and its range.

    `covariance` (3, 3) is of (azimuth, polar angle, range) in rad and m, infinite on the diagonal where the geometry
    determines nothing (and zero beside it); the deviations are its roots. `crb_rad` is the bound at the noise seen,
    with an unknown phase, as a great circle; it knows neither of pose errors nor of a second path, the covariance may.
    `coherence` is sqrt(power) of the peak. `reliability` (0..1) falls with rival peaks and poor coherence.

    What is not `observable` may be anything; `range_m` is None then. `alternatives` are the directions that this
    aperture cannot tell from the reported one: the mirror image of a planar one. `paths` are the highest peaks, the
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


class Estimator(Protocol):
    """Anything that makes a direction of an aperture; pure, and deterministic for the same aperture."""

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and the profile it was read from. Raises ApertureError."""


def estimate_aoa(aperture: Aperture) -> tuple[AoaEstimate, Profile]:
    """The `robust` estimate with its defaults. Raises ApertureError."""
    # Estimators import this module for what they return.
    from wsr.estimators.robust import Robust

    return Robust().estimate(aperture)


def describe(
    aperture: Aperture,
    channel: NDArray[np.complex128],
    best: Peak,
    mirror: Peak | None,
    rivals: tuple[Peak, ...],
) -> AoaEstimate:
    """Everything an estimate says about itself, given where the peak is; for any estimator."""
    residual = _residual_phase(aperture, channel, best)
    bound = crb(
        aperture.chi_m,
        aperture.wavelength_m,
        best.azimuth_rad,
        best.polar_rad,
        phase_variance(residual),
    )
    azimuth_observable, polar_observable = _observable(aperture, best, mirror, bound)
    inflation = time_correlation(residual)
    coherence = math.sqrt(min(best.power, 1.0))
    strongest_rival = max((rival.power / best.power for rival in rivals), default=0.0)
    cross = bound.covariance_rad2 * inflation
    return AoaEstimate(
        azimuth_rad=float(wrap_angle(best.azimuth_rad)),
        polar_rad=best.polar_rad,
        azimuth_std_rad=math.sqrt(bound.azimuth_rad2 * inflation),
        polar_std_rad=math.sqrt(bound.polar_rad2 * inflation),
        covariance=(
            (bound.azimuth_rad2 * inflation, cross, 0.0),
            (cross, bound.polar_rad2 * inflation, 0.0),
            (0.0, 0.0, math.inf),
        ),
        crb_rad=bound.great_circle_rad,
        coherence=coherence,
        reliability=coherence * max(0.0, 1.0 - strongest_rival),
        azimuth_observable=azimuth_observable,
        polar_observable=polar_observable,
        alternatives=() if mirror is None else (mirror,),
        paths=(best, *rivals),
        packets=aperture.packets,
        length_m=aperture.length_m,
        extents_m=aperture.extents_m,
        reference_p_m=aperture.reference_p_m,
        reference_t_s=aperture.reference_t_s,
    )


def _observable(aperture: Aperture, best: Peak, mirror: Peak | None, bound: Crb) -> tuple[bool, bool]:
    """Whether the aperture tells the azimuth, the polar angle."""
    if aperture.dimension == 1:
        return False, False
    azimuth = math.sqrt(bound.azimuth_rad2) < _OBSERVABLE_RAD
    polar = math.sqrt(bound.polar_rad2) < _OBSERVABLE_RAD
    if mirror is None:
        return azimuth, polar
    azimuth = azimuth and abs(float(wrap_angle(best.azimuth_rad - mirror.azimuth_rad))) < _OBSERVABLE_RAD
    # Over a horizontal plane the polar angle acts through its sine only, which is flat where ground robots are.
    polar = polar and not is_horizontal(aperture.principal_axes[2])
    return azimuth, polar and abs(best.polar_rad - mirror.polar_rad) < _OBSERVABLE_RAD


def is_horizontal(normal: Array) -> bool:
    return abs(float(normal[2])) > math.cos(_HORIZONTAL_RAD)


def _residual_phase(aperture: Aperture, channel: NDArray[np.complex128], peak: Peak) -> Array:
    """Phase (M,) of each packet that the direction leaves unexplained, about the common phase."""
    u = direction(peak.azimuth_rad, peak.polar_rad)
    turned = channel * np.exp(-4j * np.pi / aperture.wavelength_m * (aperture.chi_m @ u))
    return np.asarray(np.angle(turned * turned.sum().conj()))
