"""The AOA profile: Bartlett power over all directions.

    F(u) = |sum_k g_k exp(-j 4 pi u . chi_k / lambda)|^2 / (sum_k |g_k|)^2

with g the round-trip product, whose phase is +4 pi u . chi / lambda towards the transmitter. A perfectly coherent
aperture has F = 1 at the peak.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.directions import AZIMUTH_RAD, POLAR_RAD, ROWS, Profile
from wsr.errors import ApertureError
from wsr.kernel import bartlett_power
from wsr.skeleton import condensed

_FEW = 120
"""So few packets are summed as they are."""
_MOST_FINE = 5

Array = NDArray[np.float64]


def bartlett_profile(
    chi_m: Array, channel: NDArray[np.complex128], wavelength_m: float, cells: bool = False
) -> Profile:
    """Profile on the one-degree grid (180, 360) from displacements (M, 3) in metres and round-trip channels (M,), that
    of the defining sum to 1e-4 of its maximum.

    The field of an aperture of radius R holds angular frequencies up to 4 pi R / lambda. Above 180, some 0.8 m from the
    middle at 5.5 GHz, lobes fit between the points of the grid, and the profile says that it is undersampled. With
    `cells` it is then computed in 3 or 5 times finer steps, and holds the maximum of the cell around each point.

    Raises ApertureError if the channel is zero everywhere or anything is not finite.
    """
    scale = _amplitude_sum(chi_m, channel)
    # Scaled first: products of raw CSI squared and summed would leave the range in which float32 is exact enough.
    x, g = chi_m * (2.0 / wavelength_m), channel / scale
    needed = max(1, 1 + 2 * math.ceil((bandwidth(x) / ROWS - 1.0) / 2.0))
    finer = min(needed, _MOST_FINE) if cells else 1
    if len(g) > _FEW:
        x, columns, _ = condensed(x, g[:, None])
        g = columns[:, 0]
    power = bartlett_power(x, g, finer * ROWS)
    if finer > 1:
        power = _highest(power, finer)
    return Profile(power, AZIMUTH_RAD, POLAR_RAD, undersampled=needed > finer)


def bandwidth(x: Array) -> float:
    """Highest angular frequency of the field of packets at x (M, 3) in wavelengths of the phase, about their middle."""
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    return 2.0 * math.pi * math.sqrt(float(((x - middle) ** 2).sum(axis=1).max()))


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


def _highest(power: NDArray[np.float32], finer: int) -> NDArray[np.float32]:
    """Maxima of the cells around the points of the one-degree grid, of a grid an odd number of times finer."""
    # Rows of both lie half a step off the pole; the middle column of a cell is the coarse one.
    cells = np.roll(power, finer // 2, axis=1).reshape(ROWS, finer, 2 * ROWS, finer)
    return np.ascontiguousarray(cells.max(axis=(1, 3)))
