"""The paper's estimator: one subcarrier, phases counted from the first position, the highest point of the grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.estimators.description import describe, without_image
from wsr.estimators.trust import Evidence
from wsr.peaks import Peak, find_peaks, mirrored
from wsr.profile import Profile, bartlett_profile

_PATHS = 5


@dataclass(frozen=True, slots=True)
class Bartlett:
    """As published, but with the sign and the 4 pi / lambda that hold (see docs/maths.md).

    `subcarrier` counts from 0 over the 30 reported ones; without channels per subcarrier the aperture's `channel` is
    used. Amplitudes stay as measured. The reference point is the first position, as in the paper; a wave that is not
    flat over the aperture is in truth seen from its middle.
    """

    subcarrier: int = 15

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and its profile. Raises ApertureError."""
        channel = aperture.channel
        if aperture.forward is not None and aperture.reverse is not None:
            column = self.subcarrier if aperture.forward.shape[1] > self.subcarrier else 0
            channel = aperture.forward[:, column].astype(np.complex128) * aperture.reverse[:, column]
        profile = bartlett_profile(aperture.chi_m, channel, aperture.wavelength_m)
        best, *others = find_peaks(profile, _PATHS)
        image = _image(aperture, best)
        rivals = without_image(tuple(others), best, image)
        evidence = Evidence(
            coherence=math.sqrt(min(best.power, 1.0)),
            rival=max((rival.relative_power for rival in rivals), default=0.0),
            packets=aperture.packets,
            length_wavelengths=2 * aperture.extents_m[0] / aperture.wavelength_m,
        )
        estimate = describe(aperture, channel, best, image, rivals, evidence)
        x, y, z = (float(v) for v in np.array(aperture.reference_p_m) + aperture.chi_m[0])
        return replace(estimate, reference_p_m=(x, y, z), reference_t_s=float(aperture.t_s[0])), profile


def _image(aperture: Aperture, best: Peak) -> Peak | None:
    """The mirror image through the plane of a planar aperture."""
    return mirrored(best, aperture.principal_axes[2]) if aperture.dimension == 2 else None
