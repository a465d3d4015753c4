"""The Cramer-Rao bound of one direction from any aperture.

Packet k has phase  4 pi u . chi_k / lambda + phi0 + noise  with phase variance s_k^2. With K = 4 pi / lambda (2 pi /
lambda for a one-way channel) and d_k = K (du/dtheta . chi_k, du/dphi . chi_k) the Fisher information is

    J = sum_k d_k d_k^T / s_k^2                         phi0 known,
    J = sum_k (d_k - d)(d_k - d)^T / s_k^2              phi0 unknown, d the mean weighted by 1 / s_k^2,

and the bound is its inverse. In the paper's letters, J ~ [[A, C], [C, B]] for (theta, phi): CRB_theta = B / (AB - C^2),
CRB_phi = A / (AB - C^2). See docs/maths.md for where the paper differs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Phase = Literal["known", "unknown"]

# A tangent direction counts as measured when its singular value is not float noise of the whole aperture (1e-16 in
# double precision, 1e-7 for positions that were once float32). Of the whole aperture, not of the other direction's: a
# line seen end-on measures neither, and its noise in one is as large as in the other.
RANK_TOLERANCE = 1e-6

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Crb:
    """Lower bounds: variances in rad^2 and the great-circle standard deviation in rad.

    `great_circle_rad` is sqrt(polar + sin^2(polar angle) azimuth). A variance is infinite where the aperture does not
    determine that angle; the covariance is then zero.
    """

    azimuth_rad2: float
    polar_rad2: float
    covariance_rad2: float
    great_circle_rad: float


def fim(
    chi_m: Array,
    wavelength_m: float,
    azimuth_rad: float,
    polar_rad: float,
    *,
    phase_variance_rad2: ArrayLike = 1.0,
    phase: Phase = "unknown",
    round_trip: bool = True,
) -> Array:
    """Fisher information (2, 2) of (azimuth, polar angle), in rad^-2.

    `chi_m` (M, 3) in metres; `phase_variance_rad2` a scalar or (M,), of the product: s_f^2 / (2 |h_f|^2) +
    s_r^2 / (2 |h_r|^2). Without `round_trip` the channel is one-way and the scale 2 pi / lambda, as the paper has it.
    """
    whitened = whitened_positions(chi_m, wavelength_m, phase_variance_rad2, phase, round_trip=round_trip)
    rows = whitened @ _tangent(azimuth_rad, polar_rad).T * np.array([math.sin(polar_rad), 1.0])
    return np.asarray(rows.T @ rows)


def crb(
    chi_m: Array,
    wavelength_m: float,
    azimuth_rad: float,
    polar_rad: float,
    *,
    phase_variance_rad2: ArrayLike = 1.0,
    phase: Phase = "unknown",
    round_trip: bool = True,
) -> Crb:
    """The bound for the same arguments as `fim`.

    Rank is judged in the tangent plane, on singular values: where one direction is not measured at all, an angle has
    a finite bound only if its own axis has no part along that direction. So a straight aperture gives infinity but
    for the sources where one axis lies exactly across it.
    """
    whitened = whitened_positions(chi_m, wavelength_m, phase_variance_rad2, phase, round_trip=round_trip)
    rows = whitened @ _tangent(azimuth_rad, polar_rad).T
    values, axes = np.linalg.svd(rows, full_matrices=False)[1:]
    if rows.shape[0] < 2:
        values, axes = np.append(values, 0.0), np.vstack([axes, [-axes[0, 1], axes[0, 0]]])
    noise = RANK_TOLERANCE * float(np.linalg.norm(whitened))
    if values[0] <= noise:
        return Crb(math.inf, math.inf, 0.0, math.inf)
    if values[1] > noise:
        tangent = (axes.T / values**2) @ axes
    else:
        tangent = np.outer(axes[0], axes[0]) / values[0] ** 2
        blind = np.abs(axes[1]) > RANK_TOLERANCE
        tangent[blind, blind] = math.inf
        tangent[0, 1] = tangent[1, 0] = 0.0
    return _from_tangent(tangent, math.sin(polar_rad))


def whitened_positions(
    chi_m: Array,
    wavelength_m: float,
    phase_variance_rad2: ArrayLike = 1.0,
    phase: Phase = "unknown",
    *,
    round_trip: bool = True,
) -> Array:
    """Positions (M, 3) in radians of phase over the phase deviation, about their weighted mean if the phase is unknown.

    Along a tangent direction of the sphere these are the rows of the Jacobian.
    """
    positions = np.asarray(chi_m, np.float64)
    weights = 1.0 / np.broadcast_to(np.asarray(phase_variance_rad2, np.float64), positions.shape[:1])
    if phase == "unknown":
        positions = positions - weights @ positions / weights.sum()
    wavenumber = (4.0 if round_trip else 2.0) * math.pi / wavelength_m
    return np.asarray(positions * (wavenumber * np.sqrt(weights))[:, None])


def _tangent(azimuth_rad: float, polar_rad: float) -> Array:
    """Unit vectors (2, 3) eastwards and polewards on the sphere."""
    sin_p, cos_p = math.sin(azimuth_rad), math.cos(azimuth_rad)
    sin_t, cos_t = math.sin(polar_rad), math.cos(polar_rad)
    return np.array([[-sin_p, cos_p, 0.0], [cos_t * cos_p, cos_t * sin_p, -sin_t]])


def _from_tangent(tangent: Array, sin_t: float) -> Crb:
    """Azimuth turns sin(polar angle) times as far on the sphere; at a pole it means nothing."""
    great_circle = math.sqrt(float(tangent[0, 0] + tangent[1, 1]))
    if sin_t < 1e-12:
        return Crb(math.inf, float(tangent[1, 1]), 0.0, great_circle)
    return Crb(
        azimuth_rad2=float(tangent[0, 0]) / sin_t**2,
        polar_rad2=float(tangent[1, 1]),
        covariance_rad2=float(tangent[0, 1]) / sin_t,
        great_circle_rad=great_circle,
    )
