"""The profile by its definition: what the kernel is compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Profile
from wsr.geometry import direction


def bartlett_profile_oracle(
    chi_m: NDArray[np.float64], channel: NDArray[np.complex128], wavelength_m: float
) -> Profile:
    """As `wsr.profile.bartlett_profile`, by the defining sum in complex128, row by row: slow, nothing checked."""
    scale = float(np.abs(channel).sum())
    wavenumber = 4 * np.pi / wavelength_m
    power = np.empty((POLAR_RAD.size, AZIMUTH_RAD.size), np.float32)
    for row, polar in enumerate(POLAR_RAD):
        steering = np.exp(-1j * wavenumber * (direction(AZIMUTH_RAD, polar) @ chi_m.T))
        power[row] = np.abs(steering @ channel / scale) ** 2
    return Profile(power, AZIMUTH_RAD, POLAR_RAD)
