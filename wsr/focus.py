"""The search: a coarse look over directions and ranges, then quadratic steps to the maximum between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.geometry import direction
from wsr.machine_code import compiled, inner
from wsr.subapertures import SubApertures, delay_weight, score, score_grid

# A step of the refinement stays within 1.5 of its own grid; the grid shrinks to a twentieth of a beam width.
_MAX_STEP = 1.5
_LEAST_BEAM_WIDTHS = 0.05
_LOG_RANGE_STEP, _LEAST_LOG_RANGE_STEP = 0.35, 0.08
_MIN_RANGE_M, _MAX_RANGE_M = 0.5, 80.0
_POLE_RAD = 1e-3
# Of the highest score that the shortest sub-apertures have in the first look.
_HOPEFUL = 0.4

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Look:
    """A coarse look: azimuth_rad (N,), polar_rad (N,) and units (N, 3), the directions; combined (N, R) the mean over
    scales of the scores divided by their maxima `peak` (K,), of it power (N,) the best over the ranges, 1 at the
    maximum of all; ranges_m (R,), and where each row of constant polar angle starts, rows (T + 1,)."""

    azimuth_rad: Array
    polar_rad: Array
    units: Array
    combined: Array
    power: Array
    peak: Array
    ranges_m: tuple[float | None, ...]
    rows: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Focus:
    """Where the waves come together: direction, range, and there the coherence of the whole aperture."""

    azimuth_rad: float
    polar_rad: float
    range_m: float | None
    coherence: float


@dataclass(frozen=True, slots=True)
class Bounds:
    """Polar angles that the refinement keeps to; over a horizontal plane the upper image of both."""

    low_rad: float = _POLE_RAD
    high_rad: float = math.pi - _POLE_RAD
    planar: bool = False


@lru_cache(maxsize=4)
def sphere_grid(azimuth_step_rad: float) -> tuple[Array, Array, NDArray[np.int64]]:
    """Azimuths and polar angles (N,), and rows (T + 1,): rows one and a half steps apart, thinned towards the poles."""
    azimuths, polars, rows = [], [], [0]
    for polar in np.arange(0.75 * azimuth_step_rad, math.pi, 1.5 * azimuth_step_rad):
        count = max(8, math.ceil(2 * math.pi * math.sin(polar) / azimuth_step_rad))
        azimuths.append(-math.pi + 2 * math.pi / count * np.arange(count))
        polars.append(np.full(count, polar))
        rows.append(rows[-1] + count)
    grid = np.concatenate(azimuths), np.concatenate(polars), np.array(rows)
    for axis in grid:
        axis.flags.writeable = False
    return grid


@lru_cache(maxsize=4)
def sphere_directions(azimuth_step_rad: float) -> Array:
    """Unit vectors (N, 3) of `sphere_grid`."""
    units = direction(*sphere_grid(azimuth_step_rad)[:2])
    units.flags.writeable = False
    return units


def circle_grid(azimuth_step_rad: float, polars_rad: Sequence[float]) -> tuple[Array, Array, NDArray[np.int64]]:
    """The same with full circles at a few polar angles."""
    circle = np.arange(-math.pi, math.pi - 1e-9, azimuth_step_rad)
    rows = circle.size * np.arange(len(polars_rad) + 1)
    return np.tile(circle, len(polars_rad)), np.repeat(np.asarray(polars_rad, float), circle.size), rows


def look(
    parts: SubApertures, azimuth_step_rad: float, ranges_m: Sequence[float | None], delay_ns: float | None
) -> Look:
    """Scores of a `sphere_grid`, fused over scales: each scale counts as much as the others. At a middle range all
    directions; at the others those that have hope by that, and 0 elsewhere.

    Hope is by the shortest sub-apertures alone, which see a source's direction whatever its range; of a near one long
    ones may see nothing there, and a side lobe elsewhere.
    """
    grid, u, middle = sphere_grid(azimuth_step_rad), sphere_directions(azimuth_step_rad), len(ranges_m) // 2
    first = score(parts, u, ranges_m[middle : middle + 1], delay_ns).score
    scores = np.zeros((*first.shape[:2], len(ranges_m)), np.float32)
    scores[:, :, middle] = first[:, :, 0]
    others = [r for r in range(len(ranges_m)) if r != middle]
    if others:
        hopeful = _hopeful(first)
        scores[:, hopeful[:, None], others] = score(parts, u[hopeful], [ranges_m[r] for r in others], delay_ns).score
    return _fused(grid, u, scores, ranges_m)


def look_around(
    parts: SubApertures,
    circles: tuple[Array, Array, NDArray[np.int64]],
    ranges_m: Sequence[float | None],
    delay_ns: float | None,
) -> Look:
    """The same over circles: of the first one all azimuths, at a middle range; of all circles, and at every range, the
    azimuths that have hope by that, whatever their polar angle; 0 elsewhere."""
    u, rows, middle = direction(*circles[:2]), circles[2], len(ranges_m) // 2
    first = score(parts, u[: rows[1]], ranges_m[middle : middle + 1], delay_ns).score
    hopeful = (rows[:-1, None] + _hopeful(first)).ravel()
    scores = np.zeros((len(first), len(u), len(ranges_m)), np.float32)
    scores[:, : rows[1], middle] = first[:, :, 0]
    scores[:, hopeful] = score(parts, u[hopeful], ranges_m, delay_ns).score
    return _fused(circles, u, scores, ranges_m)


def _hopeful(first: Array32) -> Indices:
    """Directions whose shortest sub-apertures have hope, of scores (K, N, 1)."""
    hope = first[-1, :, 0]
    return np.flatnonzero(hope > _HOPEFUL * hope.max())


def _fused(
    grid: tuple[Array, Array, NDArray[np.int64]], units: Array, scores: Array32, ranges_m: Sequence[float | None]
) -> Look:
    azimuth, polar, rows = grid
    peak = scores.max(axis=(1, 2)).astype(np.float64)
    combined = (scores / peak.astype(np.float32)[:, None, None]).mean(axis=0).astype(np.float64)
    best = combined[:, 0]
    for r in range(1, combined.shape[1]):
        best = np.maximum(best, combined[:, r])
    return Look(
        azimuth_rad=azimuth,
        polar_rad=polar,
        units=units,
        combined=combined,
        power=best / best.max(),
        peak=peak,
        ranges_m=tuple(ranges_m),
        rows=rows,
    )


def refine(
    parts: SubApertures,
    start: tuple[float, float, float | None],
    peak: Array,
    step_rad: float,
    *,
    beam_rad: float,
    bounds: Bounds,
    delay_ns: float | None,
    coherent_above: float,
    steps: int,
) -> Focus:
    """Climb from `start` (azimuth, polar, range) by quadratics through 3 x 3 x 3 scores, shrinking.

    After half of the steps an aperture whose coherence is above `coherent_above` goes on as a whole, without a
    weight for the delay: the sum of all is then the best there is, and the bound of `wsr.crb` within reach.
    """
    azimuth, polar, range_m = start
    wave_m = parts.wavelength_m
    azimuth, polar, inverse, coherence = _climb(
        *parts.arrays(delay_ns is not None),
        math.inf if delay_ns is None else delay_ns,
        (azimuth, polar, 0.0 if range_m is None else wave_m / range_m),
        peak,
        (step_rad / 2, _LEAST_BEAM_WIDTHS * beam_rad),
        (wave_m / _MAX_RANGE_M, wave_m / _MIN_RANGE_M),
        (bounds.low_rad, bounds.high_rad, bounds.planar),
        coherent_above,
        steps,
    )
    return Focus(azimuth, polar, None if range_m is None else wave_m / inverse, coherence)


_late = compiled(delay_weight)


@compiled
def _climb(
    x: Array32,
    x2: Array32,
    h: Array32,
    cuts: Indices,
    pieces: Indices,
    lag: NDArray[np.complex64],
    power: float,
    delay_ns: float,
    start: tuple[float, float, float],
    peak: Array,
    steps_rad: tuple[float, float],
    inverses: tuple[float, float],
    polars: tuple[float, float, bool],
    coherent_above: float,
    steps: int,
) -> tuple[float, float, float, float]:
    """Azimuth, polar angle, inverse range a wavelength (0: far field, and stays so) and coherence; see `refine`.

    All steps in machine code: called one by one, most of their time would go into the calls.
    """
    azimuth, polar, inverse = start
    d, least_d = steps_rad
    log_step, spans = _LOG_RANGE_STEP, 3 if inverse > 0.0 else 1
    scales, best = peak.size, 0.0
    lanes = 9 * spans
    u, inverses_n = np.empty((lanes, 3), np.float32), np.zeros(lanes, np.float32)
    coherence, phase = np.empty((1, scales, lanes), np.float32), np.zeros((1, scales, lanes), np.float32)
    cube, move = np.empty((3, 3, spans)), np.empty(3)
    for step in range(steps):
        d_azimuth, d_polar = d / max(math.sin(polar), 0.1), d * (3.0 if polars[2] else 1.0)
        for n in range(lanes):
            a, t = azimuth + (n // (3 * spans) - 1) * d_azimuth, polar + (n // spans % 3 - 1) * d_polar
            u[n, 0], u[n, 1], u[n, 2] = math.sin(t) * math.cos(a), math.sin(t) * math.sin(a), math.cos(t)
            if spans == 3:
                inverses_n[n] = min(max(inverse * math.exp((1 - n % 3) * log_step), inverses[0]), inverses[1])
        score_grid(x, x2, h, cuts, pieces, lag, power, u, inverses_n, coherence, phase)
        top = 0
        for n in range(lanes):
            value = 0.0
            for k in range(scales):
                late = _late(phase[0, k, n], delay_ns) if lag.size > 0 else 1.0
                value += coherence[0, k, n] * late / peak[k]
            cube[n // (3 * spans), n // spans % 3, n % spans] = value / scales
            if value > scales * cube[top // (3 * spans), top // spans % 3, top % spans]:
                top = n
        best = float(coherence[0, 0, top])
        move[0], move[1], move[2] = top // (3 * spans) - 1, top // spans % 3 - 1, top % spans - 1
        if spans == 3:
            _newton(cube, move)
        else:
            move[2] = 0.0
        azimuth += move[0] * d_azimuth
        polar += move[1] * d_polar
        if polars[2] and polar > math.pi / 2:
            polar = math.pi - polar
        polar = min(max(polar, polars[0]), polars[1])
        if spans == 3:
            inverse = min(max(inverse * math.exp(-move[2] * log_step), inverses[0]), inverses[1])
        if max(abs(move[0]), abs(move[1]), abs(move[2])) < 1.0:
            d = max(0.5 * d, least_d)
            log_step = max(0.7 * log_step, _LEAST_LOG_RANGE_STEP)
        if step == steps // 2 and best > coherent_above:
            scales, peak, whole = 1, np.ones(1), 0
            while whole < pieces.shape[0] and pieces[whole, 0] == 0:
                whole += 1
            pieces = pieces[:whole]
            lag = np.zeros((0, 0), np.complex64)
    return azimuth, polar, inverse, best


@inner
def _newton(c: Array, move: Array) -> None:
    """Offset (3,) of the maximum of the quadratic through (3, 3, 3) points, where it has one; else left as it is."""
    slope, curve = np.empty(3), np.empty((3, 3))
    mid = c[1, 1, 1]
    slope[0], curve[0, 0] = (c[2, 1, 1] - c[0, 1, 1]) / 2, 2 * mid - c[2, 1, 1] - c[0, 1, 1]
    slope[1], curve[1, 1] = (c[1, 2, 1] - c[1, 0, 1]) / 2, 2 * mid - c[1, 2, 1] - c[1, 0, 1]
    slope[2], curve[2, 2] = (c[1, 1, 2] - c[1, 1, 0]) / 2, 2 * mid - c[1, 1, 2] - c[1, 1, 0]
    curve[1, 0] = -(c[2, 2, 1] + c[0, 0, 1] - c[2, 0, 1] - c[0, 2, 1]) / 4
    curve[2, 0] = -(c[2, 1, 2] + c[0, 1, 0] - c[2, 1, 0] - c[0, 1, 2]) / 4
    curve[2, 1] = -(c[1, 2, 2] + c[1, 0, 0] - c[1, 2, 0] - c[1, 0, 2]) / 4
    # Cholesky's factors in place; a pivot that is not positive: no maximum.
    least = 1e-9 * max(abs(curve[0, 0]), abs(curve[1, 1]), abs(curve[2, 2]))
    for i in range(3):
        for j in range(i + 1):
            for k in range(j):
                curve[i, j] -= curve[i, k] * curve[j, k]
            if i != j:
                curve[i, j] /= curve[j, j]
            elif curve[i, i] > least:
                curve[i, i] = math.sqrt(curve[i, i])
            else:
                return
    for i in range(3):
        for k in range(i):
            slope[i] -= curve[i, k] * slope[k]
        slope[i] /= curve[i, i]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            slope[i] -= curve[k, i] * slope[k]
        slope[i] /= curve[i, i]
    shrink = min(1.0, _MAX_STEP / max(abs(slope[0]), abs(slope[1]), abs(slope[2]), 1e-300))
    for i in range(3):
        move[i] = slope[i] * shrink
