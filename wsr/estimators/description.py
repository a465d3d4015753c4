"""What an estimate of plane waves says about itself, for any estimator that has found where the peak is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.crb import Crb, crb
from wsr.directions import Peak
from wsr.estimators.cone import on_cone
from wsr.estimators.trust import Evidence, model_error_rad, reliability
from wsr.geometry import direction, great_circle, wrap_angle
from wsr.peaks import MIN_SEPARATION_RAD
from wsr.uncertainty import phase_variance, time_correlation

# A plane within this tilt of the horizon is "horizontal": it decides which of two mirror images is reported.
_HORIZONTAL_RAD = math.radians(30.0)
# An angle is observable when its bound is below this and both mirror images agree on it as closely.
_OBSERVABLE_RAD = math.radians(10.0)

Array = NDArray[np.float64]


def describe(
    aperture: Aperture,
    channel: NDArray[np.complex128],
    best: Peak,
    mirror: Peak | None,
    *,
    others: tuple[Peak, ...],
    evidence: Evidence | None = None,
) -> AoaEstimate:
    """The estimate for a peak at `best`, its image `mirror` through a planar path, and the `others` found.

    Bound and noise are those of the round-trip product, `channel` (M,). With `evidence` its model error is added to the
    covariance and its reliability is taken; without, the deviation is the noise's alone, and the reliability the
    coherence of the peak times its lead over the others.
    """
    rivals = without_image(others, best, mirror)
    residual = _residual_phase(aperture, channel, best)
    variance = phase_variance(residual)
    limit = crb(aperture.chi_m, aperture.wavelength_m, best.azimuth_rad, best.polar_rad, phase_variance_rad2=variance)
    azimuth_observable, polar_observable = _observable(aperture, best, mirror, limit)
    inflation = time_correlation(residual)
    coherence = math.sqrt(min(best.power, 1.0))
    model_rad = 0.0
    reliable = coherence * max(0.0, 1.0 - max((rival.power / best.power for rival in rivals), default=0.0))
    if evidence is not None:
        coherence, model_rad = evidence.coherence, model_error_rad(evidence)
        reliable = reliability(evidence)
    azimuth_rad2 = limit.azimuth_rad2 * inflation + (model_rad / max(math.sin(best.polar_rad), 1e-6)) ** 2
    polar_rad2 = limit.polar_rad2 * inflation + model_rad**2
    cross = limit.covariance_rad2 * inflation
    estimate = AoaEstimate(
        azimuth_rad=float(wrap_angle(best.azimuth_rad)),
        polar_rad=best.polar_rad,
        azimuth_std_rad=math.sqrt(azimuth_rad2),
        polar_std_rad=math.sqrt(polar_rad2),
        covariance=((azimuth_rad2, cross, 0.0), (cross, polar_rad2, 0.0), (0.0, 0.0, math.inf)),
        crb_rad=limit.great_circle_rad,
        coherence=coherence,
        reliability=reliable * _certainty(aperture, limit, azimuth_observable),
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
    if aperture.dimension > 1:
        return estimate
    return on_cone(
        estimate,
        aperture,
        aperture.chi_m,
        variance * inflation,
        wavelength_m=aperture.wavelength_m / 2,
        model_rad=model_rad,
    )


def without_image(others: tuple[Peak, ...], best: Peak, mirror: Peak | None) -> tuple[Peak, ...]:
    """The other peaks, but for those next to the reported one and its mirror image, which is no second path."""
    taken = _directions([best] if mirror is None else [best, mirror])
    apart = great_circle(_directions(others)[:, None], taken).min(axis=1)
    return tuple(peak for peak, angle in zip(others, apart, strict=True) if angle >= MIN_SEPARATION_RAD)


def _directions(peaks: Sequence[Peak]) -> Array:
    """Unit vectors (N, 3)."""
    return direction([peak.azimuth_rad for peak in peaks], [peak.polar_rad for peak in peaks])


def is_horizontal(normal: Array) -> bool:
    """Whether a plane with this unit normal (3,) is a level one: of two mirror images the upper is reported then."""
    return abs(float(normal[2])) > math.cos(_HORIZONTAL_RAD)


def _observable(aperture: Aperture, best: Peak, mirror: Peak | None, limit: Crb) -> tuple[bool, bool]:
    """Whether the aperture tells the azimuth, the polar angle; of a straight one see `wsr.estimators.cone`."""
    if aperture.dimension == 1:
        return False, False
    azimuth = math.sqrt(limit.azimuth_rad2) < _OBSERVABLE_RAD
    polar = math.sqrt(limit.polar_rad2) < _OBSERVABLE_RAD
    if mirror is None:
        return azimuth, polar
    azimuth = azimuth and abs(float(wrap_angle(best.azimuth_rad - mirror.azimuth_rad))) < _OBSERVABLE_RAD
    # Over a horizontal plane the polar angle acts through its sine only, which is flat where ground robots are.
    polar = polar and not is_horizontal(aperture.principal_axes[2])
    return azimuth, polar and abs(best.polar_rad - mirror.polar_rad) < _OBSERVABLE_RAD


def _certainty(aperture: Aperture, limit: Crb, azimuth_observable: bool) -> float:
    """What geometry leaves of a reliability: 1/2 where a mirror image has another azimuth, 0 where none is known."""
    if azimuth_observable or aperture.dimension == 1:
        return 1.0
    return 0.5 if math.sqrt(limit.azimuth_rad2) < _OBSERVABLE_RAD else 0.0


def _residual_phase(aperture: Aperture, channel: NDArray[np.complex128], peak: Peak) -> Array:
    """Phase (M,) of each packet that the direction leaves unexplained, about the common phase."""
    u = direction(peak.azimuth_rad, peak.polar_rad)
    turned = channel * np.exp(-4j * np.pi / aperture.wavelength_m * (aperture.chi_m @ u))
    return np.asarray(np.angle(turned * turned.sum().conj()))
