"""An estimator of your own: a matched filter that looks at phases alone, so that no loud packet outvotes the others."""

from __future__ import annotations

import math

import numpy as np

from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.directions import Profile
from wsr.errors import ApertureError
from wsr.estimators.description import describe
from wsr.estimators.trust import Evidence
from wsr.peaks import find_peaks, mirrored
from wsr.profile import bartlett_profile

PATHS = 4


class PhaseOnly:
    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and its profile. Raises ApertureError."""
        loud = np.abs(aperture.channel)
        if not loud.all():
            raise ApertureError(f"{np.count_nonzero(loud == 0)} packets have no signal; expected one in each")
        channel = aperture.channel / loud
        profile = bartlett_profile(aperture.chi_m, channel, aperture.wavelength_m)
        best, *others = find_peaks(profile, PATHS)
        # Through a planar path nothing tells the two sides apart: the other one is an alternative, and no rival.
        image = mirrored(best, aperture.principal_axes[2]) if aperture.dimension == 2 else None
        evidence = Evidence(
            coherence=math.sqrt(min(best.power, 1.0)),
            rival=max((peak.relative_power for peak in others), default=0.0),
            length_wavelengths=2 * aperture.extents_m[0] / aperture.wavelength_m,
        )
        return describe(aperture, channel, best, image, others=tuple(others), evidence=evidence), profile
