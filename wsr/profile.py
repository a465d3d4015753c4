"""The AOA profile: Bartlett power over all directions.

    F(u) = |sum_k g_k exp(-j 4 pi u . chi_k / lambda)|^2 / (sum_k |g_k|)^2

with g the round-trip product, whose phase is +4 pi u . chi / lambda towards the transmitter. A perfectly coherent
aperture has F = 1 at the peak.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wsr.errors import ApertureError
from wsr.kernel import bartlett_power, grid

AZIMUTH_RAD, POLAR_RAD = grid()
"""The one-degree grid: azimuth (360,) from -180 to 179 degrees, polar angle (180,) from 0.5 to 179.5."""


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """power (T, P) float32, 1 for perfect coherence; polar_rad (T,) over its rows, azimuth_rad (P,) its columns."""

    power: NDArray[np.float32]
    azimuth_rad: NDArray[np.float64]
    polar_rad: NDArray[np.float64]


def bartlett_profile(chi_m: NDArray[np.float64], channel: NDArray[np.complex128], wavelength_m: float) -> Profile:
    """Profile on the one-degree grid (180, 360) from displacements (M, 3) in metres and round-trip channels (M,).

    Raises ApertureError if the channel is zero everywhere or anything is not finite.
    """
    scale = _amplitude_sum(chi_m, channel)
    # Scaled first: products of raw CSI squared and summed would leave the range in which float32 is exact enough.
    power = bartlett_power(chi_m * (2.0 / wavelength_m), channel / scale)
    return Profile(power, AZIMUTH_RAD, POLAR_RAD)


def profile_variance(profile: Profile, azimuth_rad: float, polar_rad: float) -> float:
    """Spread of a profile about its peak over that of a profile without one: the confidence of the WSR Toolbox.

    sum F d^2 / sum F over mean d^2, d^2 = (azimuth difference)^2 + (polar difference)^2, on the grid, with none of the
    sphere's weights; low where the power is in one place. (The toolbox divides by sum F once more, which depends on the
    number of packets alone in its normalisation and on nothing in this one.)
    """
    azimuth = np.remainder(profile.azimuth_rad - azimuth_rad + np.pi, 2 * np.pi) - np.pi
    squared = (profile.polar_rad - polar_rad)[:, None] ** 2 + azimuth[None, :] ** 2
    return float((profile.power * squared).sum() / profile.power.sum() / squared.mean())


def _amplitude_sum(chi_m: NDArray[np.float64], channel: NDArray[np.complex128]) -> float:
    scale = float(np.abs(channel).sum())
    if not (np.isfinite(scale) and np.isfinite(chi_m).all()):
        raise ApertureError("displacement or channel is not finite; expected finite values only")
    if scale == 0.0:
        raise ApertureError("channel is zero in every packet; expected a signal")
    return scale
