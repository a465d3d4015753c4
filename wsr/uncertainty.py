"""How far an estimate can be trusted: the bound of direction and range together, noise and its correlation in time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.geometry import direction
from wsr.middle import median

_NOISE_BLOCKS = 16
_RANK_TOLERANCE = 1e-6

Array = NDArray[np.float64]


def bound(
    x_m: Array,
    wavelength_m: float,
    azimuth_rad: float,
    polar_rad: float,
    *,
    range_m: float | None,
    level: bool,
    nuisance: Array | None = None,
) -> Array:
    """Cramer-Rao bound (3, 3) of (azimuth, polar angle, range) for a phase variance of 1 rad^2 and unknown phase.

    Spherical waves, phase 2 pi |r u - x| / lambda at x (B, 3): the rows of the Jacobian are 2 pi / lambda times
    (r du/daz . e, r du/dpol . e, u . e - 1) with e the unit vector from x to the source, less their mean; far field
    (None): -(du . x). `level`: the polar angle is not a free parameter. What is not free or not determined has an
    infinite variance. `nuisance` (B,): a phase of this form and unknown size is estimated too, so that what it explains
    tells nothing.
    """
    slopes = phase_slopes(x_m - x_m.mean(axis=0), wavelength_m, azimuth_rad, polar_rad, range_m=range_m)
    free = [0] if level else [0, 1]
    if range_m is not None:
        free.append(2)
    rows = (slopes - slopes.mean(axis=0))[:, free]
    if nuisance is not None:
        tau = nuisance - nuisance.mean()
        rows = rows - np.outer(tau, tau @ rows) / max(float(tau @ tau), 1e-300)
    result = np.diag(np.full(3, math.inf))
    result[np.ix_(free, free)] = _inverse(rows)
    return result


def phase_slopes(
    x_m: Array, wavelength_m: float, azimuth_rad: float, polar_rad: float, *, range_m: float | None
) -> Array:
    """Slopes (B, 3) of the phase 2 pi (|r u - x| - r) / lambda at x (B, 3) over azimuth, polar angle and range; (B, 2)
    without the range in the far field (None)."""
    du = np.stack(
        [
            [-math.sin(polar_rad) * math.sin(azimuth_rad), math.sin(polar_rad) * math.cos(azimuth_rad), 0.0],
            direction(azimuth_rad, polar_rad + math.pi / 2),
        ]
    )
    if range_m is None:
        return np.asarray(-2 * math.pi / wavelength_m * (x_m @ du.T))
    u = direction(azimuth_rad, polar_rad)
    e = range_m * u - x_m
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    return np.asarray(2 * math.pi / wavelength_m * np.column_stack([range_m * (e @ du.T), e @ u - 1.0]))


def is_determined(information: Array, scale: Array) -> bool:
    """Whether an information matrix (n, n) determines all its parameters, taken in units of 1 / scale (n,)."""
    squares = np.linalg.eigvalsh(information / np.outer(scale, scale))
    return bool(squares[0] > _RANK_TOLERANCE**2 * max(float(squares[-1]), 1e-300))


def phase_variance(residual_rad: Array) -> float:
    """Variance from the median of |phase| (1.4826 median for a normal law), so that a burst of wild packets, which
    the sum averages out, does not set it. Not below 1e-6 rad^2, less than any receiver has."""
    return max(float(1.4826 * median(np.abs(residual_rad))) ** 2, 1e-6)


def time_correlation(residual_rad: Array) -> float:
    """Factor >= 1 by which slow residuals (pose drift, curvature, multipath) raise the variance of averages over time.

    White residuals average down by the number of packets in a block; the factor is how far block means miss that.
    """
    size = residual_rad.size // _NOISE_BLOCKS
    if size < 2:
        return 1.0
    blocks = residual_rad[: size * _NOISE_BLOCKS].reshape(_NOISE_BLOCKS, size)
    single = float(np.var(blocks))
    return max(1.0, float(np.var(blocks.mean(axis=1))) * size / single) if single > 0.0 else 1.0


def _inverse(rows: Array) -> Array:
    """Inverse of rows^T rows; a parameter that takes part in what the rows do not determine has infinite variance."""
    scale = np.linalg.norm(rows, axis=0)
    dead = scale <= 0.0
    scaled = rows / np.where(dead, 1.0, scale)
    # Of the product, which is three by three: a decomposition of all rows takes five times as long.
    squares, columns = np.linalg.eigh(scaled.T @ scaled)
    axes = columns.T
    known = squares > _RANK_TOLERANCE**2 * max(float(squares.max()), 1e-300)
    inverse = (axes[known].T / squares[known]) @ axes[known]
    blind = dead | (np.abs(axes[~known]) > _RANK_TOLERANCE).any(axis=0)
    inverse[blind, :] = 0.0
    inverse[:, blind] = 0.0
    safe = np.where(dead, 1.0, scale)
    inverse = inverse / np.outer(safe, safe)
    inverse[blind, blind] = math.inf
    return np.asarray(inverse)
