"""The bound of azimuth, polar angle and range together, for spherical waves from a near source.

Packet k has phase K |r u - chi_k|, K = 4 pi / lambda, less that at the reference point. With e_k the unit vector from
chi_k to the source the rows of the Jacobian are K (r du/dazimuth . e, r du/dpolar . e, u . e - 1), over the phase
deviation; with an unknown common phase, less their weighted mean. Far away the last column vanishes as |chi|^2 / r^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.crb.bound import RANK_TOLERANCE, Phase, whitened_positions

_CHUNK_ROWS = 400_000

Array = NDArray[np.float64]


def fim_focused(
    chi_m: Array,
    wavelength_m: float,
    azimuth_rad: ArrayLike,
    polar_rad: ArrayLike,
    range_m: ArrayLike,
    phase_variance_rad2: ArrayLike = 1.0,
    phase: Phase = "unknown",
    round_trip: bool = True,
) -> Array:
    """Fisher information (N, 3, 3) of (azimuth, polar angle, range) in rad^-2, rad^-1 m^-1 and m^-2.

    chi_m (M, 3) in metres from the reference point; azimuth, polar angle and range (N,) broadcast. Memory is bounded:
    directions are taken in chunks.
    """
    arrays = np.broadcast_arrays(azimuth_rad, polar_rad, range_m)
    source = np.stack([np.atleast_1d(a).astype(np.float64) for a in arrays])
    weights = 1.0 / np.broadcast_to(np.asarray(phase_variance_rad2, np.float64), (len(chi_m),))
    wavenumber = (4.0 if round_trip else 2.0) * np.pi / wavelength_m
    chunk = max(1, _CHUNK_ROWS // max(len(chi_m), 1))
    parts = [
        _information(np.asarray(chi_m, np.float64), weights, source[:, at : at + chunk], phase == "unknown")
        for at in range(0, source.shape[1], chunk)
    ]
    return np.asarray(wavenumber**2 * np.concatenate(parts))


def crb_focused(
    chi_m: Array,
    wavelength_m: float,
    azimuth_rad: ArrayLike,
    polar_rad: ArrayLike,
    range_m: ArrayLike,
    phase_variance_rad2: ArrayLike = 1.0,
    phase: Phase = "unknown",
    round_trip: bool = True,
) -> Array:
    """Covariance bound (N, 3, 3) of (azimuth, polar angle, range), for the arguments of `fim_focused`.

    What is not determined has an infinite variance on the diagonal and zero beside it. The rank is judged after each
    parameter has been scaled to unit information, for a range in metres and an angle have no common unit.
    """
    information = fim_focused(
        chi_m, wavelength_m, azimuth_rad, polar_rad, range_m, phase_variance_rad2, phase, round_trip
    )
    size = np.sqrt(np.einsum("nii->ni", information))
    # Waves from afar look flat to rounding; what curvature is left then is no information. Nor are the angles of a
    # source at the end of a line.
    whole = float(np.linalg.norm(whitened_positions(chi_m, wavelength_m, phase_variance_rad2, phase, round_trip)))
    dead = size <= RANK_TOLERANCE * np.maximum(size.max(axis=1, keepdims=True), whole)
    scale = np.where(dead, 1.0, size)
    values, axes = np.linalg.eigh(information / (scale[:, :, None] * scale[:, None, :]))
    known = values > RANK_TOLERANCE**2 * np.maximum(values[:, -1:], 1e-300)
    inverse = np.einsum("nik,nk,njk->nij", axes, np.where(known, 1.0 / np.where(known, values, 1.0), 0.0), axes)
    blind = dead | ((np.abs(axes) > RANK_TOLERANCE) & ~known[:, None, :]).any(axis=2)
    inverse = np.where(blind[:, :, None] | blind[:, None, :], 0.0, inverse / (scale[:, :, None] * scale[:, None, :]))
    rows, columns = np.nonzero(blind)
    inverse[rows, columns, columns] = np.inf
    return np.asarray(inverse)


def _information(chi: Array, weights: Array, source: Array, is_phase_unknown: bool) -> Array:
    """(N, 3, 3) for a wavenumber of 1 and sources (3, N): azimuth, polar angle, range."""
    azimuth, polar, range_m = source
    sin_p, cos_p, sin_t, cos_t = np.sin(azimuth), np.cos(azimuth), np.sin(polar), np.cos(polar)
    zero = np.zeros_like(azimuth)
    u = np.stack([sin_t * cos_p, sin_t * sin_p, cos_t], axis=-1)
    by_azimuth = np.stack([-sin_t * sin_p, sin_t * cos_p, zero], axis=-1)
    by_polar = np.stack([cos_t * cos_p, cos_t * sin_p, -sin_t], axis=-1)
    e = (range_m[:, None] * u)[:, None, :] - chi[None, :, :]
    distance = np.linalg.norm(e, axis=-1, keepdims=True)
    e /= distance
    # u . e - 1 by the sine of the small angle between them: the difference itself would be rounding.
    across = np.linalg.norm(np.cross(u[:, None, :], e), axis=-1)
    along = np.einsum("nx,nmx->nm", u, e)
    last = np.where(along > 0.0, -(across**2) / (1.0 + along), along - 1.0)
    rows = np.stack(
        [
            range_m[:, None] * np.einsum("nx,nmx->nm", by_azimuth, e),
            range_m[:, None] * np.einsum("nx,nmx->nm", by_polar, e),
            last,
        ],
        axis=-1,
    )
    if is_phase_unknown:
        rows -= np.einsum("m,nmi->ni", weights / weights.sum(), rows)[:, None, :]
    return np.asarray(np.einsum("m,nmi,nmj->nij", weights, rows, rows, optimize=True))
