"""The bound of many directions at once: 64800 of them in tens of milliseconds.

All that an aperture says about plane waves is in its weighted scatter, so it is first reduced to the triangular factor
R (3, 3) of its whitened positions, R^T R = sum_k (chi_k - mean)(chi_k - mean)^T / s_k^2. The rows of the Jacobian for
a direction are then R e and R n, with e and n the unit vectors eastwards and polewards, whatever the number of packets.
Singular values come from one Jacobi rotation of these two columns, which keeps the small one exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.crb.bound import RANK_TOLERANCE, Phase, whitened_positions

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CrbField:
    """Bounds (N,) in rad^2 for N directions, infinite where an angle is not determined.

    `azimuth_rad2`, `polar_rad2` and `covariance_rad2` are the inverse of the 2 x 2 information; `great_circle_rad2` is
    polar + sin^2(polar angle) azimuth. `azimuth_alone_rad2` and `polar_alone_rad2` are the inverses of its diagonal
    (the paper's 1/B and 1/A): the bound of one angle when the other is known.
    """

    azimuth_rad2: Array
    polar_rad2: Array
    covariance_rad2: Array
    great_circle_rad2: Array
    azimuth_alone_rad2: Array
    polar_alone_rad2: Array


def scatter_factor(
    chi_m: Array,
    wavelength_m: float,
    phase_variance_rad2: ArrayLike = 1.0,
    phase: Phase = "unknown",
    *,
    round_trip: bool = True,
) -> Array:
    """R (3, 3) in radians of phase per unit of direction, over the phase deviation; from chi_m (M, 3) in metres.

    `phase_variance_rad2` is a scalar or (M,). `phase` and `round_trip` as in `wsr.crb.fim`.
    """
    whitened = whitened_positions(chi_m, wavelength_m, phase_variance_rad2, phase, round_trip=round_trip)
    factor = np.asarray(np.linalg.qr(whitened, mode="r"), np.float64)
    return np.vstack([factor, np.zeros((3 - factor.shape[0], 3))])


def crb_over(factor: Array, azimuth_rad: ArrayLike, polar_rad: ArrayLike) -> CrbField:
    """The bounds of directions (N,), for a `scatter_factor`. Rank is judged as in `wsr.crb.crb`."""
    azimuth, polar = (np.atleast_1d(a).astype(np.float64) for a in np.broadcast_arrays(azimuth_rad, polar_rad))
    east, pole = (tangent @ factor.T for tangent in tangents(azimuth, polar))
    noise = RANK_TOLERANCE * float(np.linalg.norm(factor))
    var_east, var_pole, cross = _inverse(east, pole, noise)
    sine = np.sin(polar)
    at_pole = sine < 1e-12
    safe = np.where(at_pole, 1.0, sine)
    alone_east, alone_pole = (_alone(column, noise) for column in (east, pole))
    return CrbField(
        azimuth_rad2=np.where(at_pole, np.inf, var_east / safe**2),
        polar_rad2=var_pole,
        covariance_rad2=np.where(at_pole, 0.0, cross / safe),
        great_circle_rad2=var_east + var_pole,
        azimuth_alone_rad2=np.where(at_pole, np.inf, alone_east / safe**2),
        polar_alone_rad2=alone_pole,
    )


def great_circle_over(factor: Array, east: Array, pole: Array) -> Array:
    """`CrbField.great_circle_rad2` (N,) alone, of directions with these `tangents`."""
    noise = RANK_TOLERANCE * float(np.linalg.norm(factor))
    var_east, var_pole, _ = _inverse(east @ factor.T, pole @ factor.T, noise)
    return np.asarray(var_east + var_pole)


def tangents(azimuth: Array, polar: Array) -> tuple[Array, Array]:
    """Unit vectors e and n, eastwards and polewards, each (N, 3)."""
    sin_p, cos_p, sin_t, cos_t = np.sin(azimuth), np.cos(azimuth), np.sin(polar), np.cos(polar)
    east = np.stack([-sin_p, cos_p, np.zeros_like(sin_p)], axis=-1)
    pole = np.stack([cos_t * cos_p, cos_t * sin_p, -sin_t], axis=-1)
    return east, pole


def _alone(column: Array, noise: float) -> Array:
    """Inverse square of the lengths (N,), infinite where these are no more than `noise`."""
    length = np.linalg.norm(column, axis=1)
    seen = length > noise
    return np.where(seen, 1.0 / np.where(seen, length, 1.0) ** 2, np.inf)


def _inverse(a: Array, b: Array, noise: float) -> tuple[Array, Array, Array]:
    """Variances of both and covariance (N,): the inverse of the Gram matrix of columns a and b (N, 3), of which what is
    no longer than `noise` measures nothing."""
    alpha, beta, gamma = (np.einsum("nk,nk->n", x, y) for x, y in ((a, a), (b, b), (a, b)))
    half = np.arctan2(2 * gamma, alpha - beta) / 2
    c, s = np.cos(half), np.sin(half)
    # Turned by `half` the columns are orthogonal, and their lengths are the singular values, the larger one first.
    first, second = (c[:, None] * a + s[:, None] * b), (c[:, None] * b - s[:, None] * a)
    large, small = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    dead, blind = large <= noise, small <= noise
    with np.errstate(divide="ignore", invalid="ignore"):
        seen, unseen = 1.0 / large**2, np.where(blind, 0.0, 1.0 / small**2)
        var_a = c**2 * seen + s**2 * unseen
        var_b = s**2 * seen + c**2 * unseen
        cross = np.where(blind, 0.0, c * s * (seen - unseen))
    var_a[dead | (blind & (np.abs(s) > RANK_TOLERANCE))] = np.inf
    var_b[dead | (blind & (np.abs(c) > RANK_TOLERANCE))] = np.inf
    return var_a, var_b, cross
