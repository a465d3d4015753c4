"""The paper's estimator: one subcarrier, phases counted from the first position, the highest point of the grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.directions import Peak, Profile
from wsr.estimators.description import describe, without_image
from wsr.estimators.trust import Evidence
from wsr.geometry import direction, great_circle
from wsr.half_turns import without_half_turns
from wsr.peaks import find_peaks, mirrored
from wsr.profile import bartlett_profile

_PATHS = 5
_USUAL_RANGE_M = 5.0

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bartlett:
    """As published, but with the sign and the 4 pi / lambda that hold (see docs/maths.md).

    `subcarrier` counts from 0 over the reported ones, None is the first above the centre; without channels per
    subcarrier the aperture's `channel` is used. Amplitudes stay as measured. The reference point is the first position,
    as in the paper; a wave that is not flat over the aperture is in truth seen from its middle.
    """

    subcarrier: int | None = None

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and its profile. Raises ApertureError."""
        aperture = without_half_turns(aperture)
        channel = aperture.channel
        if aperture.forward is not None and aperture.reverse is not None:
            column = int(np.searchsorted(aperture.grid.k, 0.0)) if self.subcarrier is None else self.subcarrier
            column = min(column, aperture.grid.size - 1)
            channel = aperture.forward[:, column].astype(np.complex128) * aperture.reverse[:, column]
        profile = bartlett_profile(aperture.chi_m, channel, aperture.wavelength_m, cells=True)
        best, *others = find_peaks(profile, _PATHS)
        image = _image(aperture, best)
        rivals = without_image(tuple(others), best, image)
        evidence = Evidence(
            coherence=math.sqrt(min(best.power, 1.0)),
            rival=_astray((best, *rivals)),
            length_wavelengths=2 * aperture.extents_m[0] / aperture.wavelength_m,
        )
        estimate = describe(aperture, channel, best, image, others=rivals, evidence=evidence)
        x, y, z = (float(v) for v in np.array(aperture.reference_p_m) + aperture.chi_m[0])
        estimate = replace(estimate, reference_p_m=(x, y, z), reference_t_s=float(aperture.t_s[0]))
        return _with_offset(estimate, aperture.chi_m[0]), profile


def _astray(peaks: tuple[Peak, ...]) -> float:
    """How far from the first peak one would be who drew one of them by the square of its power: the mean of half the
    chord, 0 if all is in the first, 1 if opposite. One subcarrier of a product has many peaks, and which of them is
    highest is often chance; side lobes beside the first would do little harm."""
    weights = np.array([peak.relative_power**2 for peak in peaks])
    u = direction([peak.azimuth_rad for peak in peaks], [peak.polar_rad for peak in peaks])
    return float(weights @ np.sin(great_circle(u, u[0]) / 2) / weights.sum())


def _with_offset(estimate: AoaEstimate, first_m: Array) -> AoaEstimate:
    """The covariance with the angle between the middle, which a curved wave is seen from, and the first position (3,)
    from it, for a source at a usual distance."""
    east = direction(estimate.azimuth_rad + math.pi / 2, math.pi / 2)
    south = direction(estimate.azimuth_rad, estimate.polar_rad + math.pi / 2)
    moved = (float(first_m @ east) / max(math.sin(estimate.polar_rad), 1e-6), float(first_m @ south))
    (azimuth, cross, _), (_, polar, _), last = estimate.covariance
    azimuth += (moved[0] / _USUAL_RANGE_M) ** 2
    polar += (moved[1] / _USUAL_RANGE_M) ** 2
    return replace(
        estimate,
        azimuth_std_rad=math.sqrt(azimuth),
        polar_std_rad=math.sqrt(polar),
        covariance=((azimuth, cross, 0.0), (cross, polar, 0.0), last),
    )


def _image(aperture: Aperture, best: Peak) -> Peak | None:
    """The mirror image through the plane of a planar aperture."""
    return mirrored(best, aperture.principal_axes[2]) if aperture.dimension == 2 else None
