"""A peak between the points of the grid: the maximum of the exact objective."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.geometry import angles, direction

_MAX_STEPS = 20
_MAX_STEP_RAD = math.radians(1.0)
_TOLERANCE_RAD = 1e-7

Array = NDArray[np.float64]


def refine_peak(
    chi_m: Array, channel: NDArray[np.complex128], wavelength_m: float, *, azimuth_rad: float, polar_rad: float
) -> tuple[float, float, float]:
    """Azimuth, polar angle and power (1 for perfect coherence) of the maximum of the exact objective near a direction.

    Newton steps on the sphere for P(u) = |s|^2, s = sum_k g_k exp(-j K u . chi_k) / sum_k |g_k|, K = 4 pi / lambda:
    grad P = 2 Re(conj(s) ds), hess P = 2 Re(conj(ds) ds^T + conj(s) d2s), both taken in the tangent plane, where the
    curvature of the sphere adds -(u . grad P) I. A step is at most one degree and is halved until it climbs, so the
    result is never lower than the start. Along a ridge, as a flat or straight aperture makes, it stays put.
    """
    chi = chi_m * (4 * np.pi / wavelength_m)
    weights = channel / np.abs(channel).sum()
    u = direction(azimuth_rad, polar_rad)
    power, gradient, hessian = _expansion(chi, weights, u)
    for _ in range(_MAX_STEPS):
        step = _newton_step(u, gradient, hessian)
        size = float(np.linalg.norm(step))
        while size > _TOLERANCE_RAD:
            trial = (u + step) / np.linalg.norm(u + step)
            trial_power, trial_gradient, trial_hessian = _expansion(chi, weights, trial)
            if trial_power > power:
                break
            step, size = step / 2, size / 2
        if size <= _TOLERANCE_RAD:
            break
        u, power, gradient, hessian = trial, trial_power, trial_gradient, trial_hessian
    azimuth, polar = angles(u)
    return float(azimuth), float(polar), power


def _expansion(chi: Array, weights: NDArray[np.complex128], u: Array) -> tuple[float, Array, Array]:
    """P, grad P (3,) and hess P (3, 3) at u, for chi in radians of phase."""
    terms = weights * np.exp(-1j * (chi @ u))
    weighted = terms[:, None] * chi
    s = terms.sum()
    ds = -1j * weighted.sum(axis=0)
    d2s = -(chi.T @ weighted)
    gradient = 2 * np.real(s.conj() * ds)
    hessian = 2 * np.real(np.outer(ds.conj(), ds) + s.conj() * d2s)
    return float(np.abs(s) ** 2), np.asarray(gradient), np.asarray(hessian)


def _newton_step(u: Array, gradient: Array, hessian: Array) -> Array:
    """Ascent step (3,) in the tangent plane at u, at most _MAX_STEP_RAD long."""
    tangent = np.linalg.svd(u[None, :])[2][1:]
    slope = tangent @ gradient
    curvature = tangent @ hessian @ tangent.T - float(u @ gradient) * np.eye(2)
    values, vectors = np.linalg.eigh(curvature)
    # Uphill whatever the sign of the curvature; directions without any (a ridge) are left alone.
    steepest = float(np.abs(values).max())
    along = vectors.T @ slope
    inverse = np.where(np.abs(values) > 1e-6 * steepest, 1.0 / np.maximum(np.abs(values), 1e-300), 0.0)
    step = np.asarray((vectors @ (inverse * along)) @ tangent)
    size = float(np.linalg.norm(step))
    return step if size <= _MAX_STEP_RAD else np.asarray(step * (_MAX_STEP_RAD / size))
