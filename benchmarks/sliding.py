"""The AOA profile of a sliding window: packets enter and leave running sums, nothing is computed twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wsr.directions import AZIMUTH_RAD, POLAR_RAD, ROWS, Profile
from wsr.kernel import add_packets, empty_sums, power_of


class SlidingProfile:
    """Bartlett profile of the packets that were added and not removed.

    Positions are about any one fixed point: another point turns all packets of a direction by the same phase, which the
    power does not show. Rounding errors stay with the sums, so a window that slides for minutes is to be started anew
    from time to time; each float32 addition leaves about 6e-8 of the sum.
    """

    def __init__(self, wavelength_m: float) -> None:
        self._half_wavelengths_per_m = 2.0 / wavelength_m
        self._sums = empty_sums(ROWS)
        self._amplitude = 0.0

    def add(self, chi_m: NDArray[np.float64], channel: NDArray[np.complex128]) -> None:
        """Packets (M, 3) in metres with round-trip channels (M,), of amplitude about 1, enter."""
        add_packets(self._sums, chi_m * self._half_wavelengths_per_m, channel)
        self._amplitude += float(np.abs(channel).sum())

    def remove(self, chi_m: NDArray[np.float64], channel: NDArray[np.complex128]) -> None:
        """Packets that were added before leave."""
        add_packets(self._sums, chi_m * self._half_wavelengths_per_m, -channel)
        self._amplitude -= float(np.abs(channel).sum())

    def profile(self) -> Profile:
        """Power (180, 360), 1 for perfect coherence. Raises ZeroDivisionError when no packet is in the window."""
        return Profile(power_of(self._sums) / np.float32(self._amplitude**2), AZIMUTH_RAD, POLAR_RAD)
