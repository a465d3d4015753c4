"""Plane waves and the round-trip product: the Bartlett peak, refined, seen from the mean position."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.refinement import refine_peak
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.channel import bounded_amplitude
from wsr.directions import Peak, Profile
from wsr.estimators.description import describe, is_horizontal
from wsr.geometry import angles, direction
from wsr.peaks import MIN_SEPARATION_RAD, find_peaks
from wsr.profile import bartlett_profile


@dataclass(frozen=True, slots=True)
class FarField:
    """Far-field Bartlett: the maximum of the profile, refined between grid points, seen from the mean position."""

    alternatives: int = 4
    min_separation_rad: float = MIN_SEPARATION_RAD

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and its profile."""
        channel = bounded_amplitude(aperture.channel)
        profile = bartlett_profile(aperture.chi_m, channel, aperture.wavelength_m)
        found = find_peaks(profile, 1 + self.alternatives, self.min_separation_rad)
        peaks = _refined(aperture, channel, found)
        best, mirror = _choose(aperture, channel, peaks[0])
        return describe(aperture, channel, best, mirror, others=peaks), profile


def _refined(aperture: Aperture, channel: NDArray[np.complex128], found: tuple[Peak, ...]) -> tuple[Peak, ...]:
    """The peaks between grid points, sorted anew: a peak that falls between grid points shows some percent too low."""
    refined = []
    for peak in found:
        azimuth, polar, power = refine_peak(
            aperture.chi_m, channel, aperture.wavelength_m, azimuth_rad=peak.azimuth_rad, polar_rad=peak.polar_rad
        )
        refined.append(replace(peak, azimuth_rad=azimuth, polar_rad=polar, power=power))
    refined.sort(key=lambda peak: -peak.power)
    top = refined[0].power
    return tuple(replace(peak, relative_power=peak.power / top) for peak in refined)


def _choose(aperture: Aperture, channel: NDArray[np.complex128], peak: Peak) -> tuple[Peak, Peak | None]:
    """The peak to report and its mirror image through the plane of a planar aperture.

    Both have the same power up to noise, so which of them the profile has higher says nothing. Over a horizontal
    plane the upper one is reported, as convention; otherwise the one found.
    """
    if aperture.dimension != 2:
        return peak, None
    normal = aperture.principal_axes[2]
    u = direction(peak.azimuth_rad, peak.polar_rad)
    azimuth, polar = (float(angle) for angle in angles(u - 2.0 * (u @ normal) * normal))
    azimuth, polar, power = refine_peak(
        aperture.chi_m, channel, aperture.wavelength_m, azimuth_rad=azimuth, polar_rad=polar
    )
    image = Peak(azimuth_rad=azimuth, polar_rad=polar, power=power, relative_power=power / peak.power)
    if is_horizontal(normal) and image.polar_rad < peak.polar_rad:
        return replace(image, relative_power=1.0), replace(peak, relative_power=peak.power / image.power)
    return peak, image
