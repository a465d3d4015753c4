"""The search: a coarse look over directions and ranges, then quadratic steps to the maximum between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.geometry import direction
from wsr.subapertures import SubApertures, climbed, score

# The grid of the refinement shrinks to a twentieth of a beam width.
_LEAST_BEAM_WIDTHS = 0.05
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
    inverse = 0.0 if range_m is None else wave_m / range_m
    state = (
        *(azimuth, polar, inverse, 0.0, step_rad / 2, _LEAST_BEAM_WIDTHS * beam_rad),
        *(wave_m / _MAX_RANGE_M, wave_m / _MIN_RANGE_M, bounds.low_rad, bounds.high_rad, float(bounds.planar)),
        *(coherent_above, math.inf if delay_ns is None else delay_ns),
    )
    azimuth, polar, inverse, coherence = climbed(parts, state, peak, delay_ns is not None, steps)
    return Focus(azimuth, polar, None if range_m is None else wave_m / inverse, coherence)
