"""The last step of a coherent estimate: the maximum of sum_s |y_s|^2 over direction and range, in float64.

With y_s = sum_b h_b(s) exp(j phi_b), m_b = sum_s h_b(s) exp(j phi_b) y_s^* and J (B, n) the slopes of the phases, less
their mean weighted by Re m, Gauss-Newton steps  -(J^T Re(m) J)^-1 J^T Im(m)  lead to where J^T Im m = 0. For white
noise that is the maximum-likelihood estimate. Grids and parabolas in float32 end within some thousandths of a degree of
it, which is more than the noise of a strong signal.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wsr.focus import Focus
from wsr.geometry import direction
from wsr.middle import median
from wsr.subapertures import SubApertures
from wsr.uncertainty import phase_slopes

_STEPS = 10
# Of angles, in radians, and of the range as a share: a step this short is the last.
_SHORT_STEP = 1e-7
# Direction and range may lie along a valley of the coarse search, some degrees and half the range away.
_REACH_RAD = math.radians(3.0)
_REACH_RANGE = 3.0
_MAX_RANGE_STEP = 0.3
_MOST_OF_MEDIAN = 4.0

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def matched(parts: SubApertures, x_m: Array, segment: NDArray[np.int64], focus: Focus) -> Complex:
    """m (B,) of bins at x (B, 3) about the centroid: each against the sum of all, over all subcarriers. Pieces of a
    broken chain of signs (`segment`, (B,)) are joined as they add up, longest sum first."""
    return _matched(_pieced(parts, segment), x_m, parts.wavelength_m, focus)


def _pieced(parts: SubApertures, segment: NDArray[np.int64]) -> tuple[Complex, NDArray[np.intp], NDArray[np.intp]]:
    """Channels (B, S), where pieces of the chain of signs begin, and the bins of each."""
    starts = np.flatnonzero(np.diff(segment, prepend=-1))
    return (parts.h[0] + 1j * parts.h[1]).T.astype(np.complex128), starts, np.diff(np.append(starts, len(segment)))


def _matched(
    pieced: tuple[Complex, NDArray[np.intp], NDArray[np.intp]], x_m: Array, wavelength_m: float, focus: Focus
) -> Complex:
    h, starts, counts = pieced
    u = direction(focus.azimuth_rad, focus.polar_rad)
    r = focus.range_m
    path = -(x_m @ u) if r is None else np.linalg.norm(r * u - x_m, axis=1) - r
    turned = h * np.exp(2j * math.pi / wavelength_m * path)[:, None]
    pieces = np.add.reduceat(turned, starts, axis=0)
    total = np.zeros(turned.shape[1], np.complex128)
    for piece in pieces[np.argsort(-np.linalg.norm(pieces, axis=1))]:
        total = total + (piece if np.vdot(total, piece).real >= 0 else -piece)
    sign = np.where((pieces @ total.conj()).real < 0, -1.0, 1.0)
    return np.asarray((turned @ total.conj()) * np.repeat(sign, counts))


def most_likely(
    parts: SubApertures,
    x_m: Array,
    segment: NDArray[np.int64],
    counts: NDArray[np.int64],
    *,
    focus: Focus,
    nuisance: Array | None = None,
) -> Focus:
    """The focus moved to the maximum next to it; `nuisance` (B,): beside a phase of this form and any size. As it is
    where the way there leads too far, or not up: geometry then does not determine all that is sought.

    Bins count by their packets (`counts`, (B,)), as white noise has it, but none more than a few times the usual: where
    a robot stood, noise is not what limits.
    """
    share = np.minimum(counts, _MOST_OF_MEDIAN * median(counts.astype(np.float64)))
    parts = replace(parts, h=parts.h * (share / share.mean()).astype(np.float32))
    pieced = _pieced(parts, segment)
    azimuth, polar, range_m = focus.azimuth_rad, focus.polar_rad, focus.range_m
    power = float(_matched(pieced, x_m, parts.wavelength_m, focus).real.sum())
    for _ in range(_STEPS):
        here = Focus(azimuth, polar, range_m, focus.coherence)
        m = _matched(pieced, x_m, parts.wavelength_m, here)
        slopes = phase_slopes(x_m, parts.wavelength_m, azimuth, polar, range_m=range_m)
        if nuisance is not None:
            slopes = np.column_stack([slopes, nuisance])
        weight = np.maximum(m.real, 0.0)
        slopes = slopes - (weight @ slopes) / max(float(weight.sum()), 1e-300)
        step = -np.linalg.lstsq(slopes.T @ (weight[:, None] * slopes), slopes.T @ m.imag, rcond=1e-10)[0]
        if range_m is not None:
            step *= min(1.0, _MAX_RANGE_STEP * range_m / max(abs(float(step[2])), 1e-12))
            range_m += float(step[2])
        azimuth, polar = azimuth + float(step[0]), polar + float(step[1])
        if not _is_near(focus, azimuth, polar, range_m):
            return focus
        further = 0.0 if range_m is None else abs(float(step[2])) / range_m
        if max(abs(float(step[0])), abs(float(step[1])), further) < _SHORT_STEP:
            break
    found = Focus(azimuth, polar, range_m, focus.coherence)
    gain = float(_matched(pieced, x_m, parts.wavelength_m, found).real.sum()) / max(power, 1e-300)
    return replace(found, coherence=focus.coherence * gain) if gain >= 1.0 else focus


def _is_near(focus: Focus, azimuth: float, polar: float, range_m: float | None) -> bool:
    across = abs(azimuth - focus.azimuth_rad) * math.sin(focus.polar_rad)
    if not (across < _REACH_RAD and abs(polar - focus.polar_rad) < _REACH_RAD and 0.0 < polar < math.pi):
        return False
    if range_m is None or focus.range_m is None:
        return True
    return 1.0 / _REACH_RANGE < range_m / focus.range_m < _REACH_RANGE
