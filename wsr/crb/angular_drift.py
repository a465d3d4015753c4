"""Angular drift of the displacement (paper, section on displacement errors): what of its two lemmas holds.

An estimated position has the true distance from the origin, but its azimuth is off by kappa_azimuth and its polar angle
by kappa_polar.

A constant azimuth offset is a rotation about z, so the peak turns by exactly that offset, for any path. A constant
added to polar angles is a rotation only of points in one vertical plane, about the normal of that plane; it moves the
peak by itself only when the source lies in that plane too. Otherwise points of different azimuth turn about different
axes, and the peak spreads.

An offset that varies moves a position by at most rho (delta + mu) and so turns its phase by at most
4 pi rho (delta + mu) / lambda; the sum keeps at least the cosine of that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.geometry import angles, direction

Array = NDArray[np.float64]


def with_angular_drift(chi_m: ArrayLike, azimuth_offset_rad: ArrayLike, polar_offset_rad: ArrayLike) -> Array:
    """Positions (M, 3) with offsets (scalar or (M,)) added to their azimuths and polar angles about the origin.

    A polar angle that leaves [0, pi] goes over the pole.
    """
    chi = np.asarray(chi_m, float)
    azimuth, polar = angles(chi)
    radius = np.linalg.norm(chi, axis=-1, keepdims=True)
    return np.asarray(
        radius * direction(azimuth + np.asarray(azimuth_offset_rad, float), polar + np.asarray(polar_offset_rad, float))
    )
