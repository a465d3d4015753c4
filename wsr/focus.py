"""The search: a coarse look over directions and ranges, then quadratic steps to the maximum between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wsr.geometry import direction
from wsr.subapertures import Scores, SubApertures, score

# A step of the refinement stays within 1.5 of its own grid; the grid shrinks to a twentieth of a beam width.
_MAX_STEP = 1.5
_LEAST_BEAM_WIDTHS = 0.05
_LOG_RANGE_STEP, _LEAST_LOG_RANGE_STEP = 0.35, 0.08
_MIN_RANGE_M, _MAX_RANGE_M = 0.5, 80.0
_POLE_RAD = 1e-3

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """A coarse look: azimuth_rad (N,), polar_rad (N,), combined (N, R) the mean over scales of the scores divided by
    their maxima `peak` (K,), ranges_m (R,), and where each row of constant polar angle starts, rows (T + 1,)."""

    azimuth_rad: Array
    polar_rad: Array
    combined: Array
    peak: Array
    ranges_m: tuple[float | None, ...]
    rows: NDArray[np.int64]

    @property
    def power(self) -> Array:
        """(N,) best over the ranges, 1 at the maximum of all."""
        best: Array = self.combined.max(axis=1)
        return np.asarray(best / best.max())


@dataclass(frozen=True, slots=True)
class Focus:
    """Where the waves come together: direction, range, and there the coherence and delay at the coarsest scale."""

    azimuth_rad: float
    polar_rad: float
    range_m: float | None
    coherence: float
    delay_ns: float


@dataclass(frozen=True, slots=True)
class Bounds:
    """Polar angles that the refinement keeps to; over a horizontal plane the upper image of both."""

    low_rad: float = _POLE_RAD
    high_rad: float = math.pi - _POLE_RAD
    planar: bool = False

    def keep(self, polar_rad: float) -> float:
        if self.planar and polar_rad > math.pi / 2:
            polar_rad = math.pi - polar_rad
        return min(max(polar_rad, self.low_rad), self.high_rad)


def sphere_grid(azimuth_step_rad: float) -> tuple[Array, Array, NDArray[np.int64]]:
    """Azimuths and polar angles (N,), and rows (T + 1,): rows one and a half steps apart, thinned towards the poles."""
    azimuths, polars, rows = [], [], [0]
    for polar in np.arange(0.75 * azimuth_step_rad, math.pi, 1.5 * azimuth_step_rad):
        count = max(8, math.ceil(2 * math.pi * math.sin(polar) / azimuth_step_rad))
        azimuths.append(-math.pi + 2 * math.pi / count * np.arange(count))
        polars.append(np.full(count, polar))
        rows.append(rows[-1] + count)
    return np.concatenate(azimuths), np.concatenate(polars), np.array(rows)


def circle_grid(azimuth_step_rad: float, polars_rad: Sequence[float]) -> tuple[Array, Array, NDArray[np.int64]]:
    """The same with full circles at a few polar angles."""
    circle = np.arange(-math.pi, math.pi - 1e-9, azimuth_step_rad)
    rows = circle.size * np.arange(len(polars_rad) + 1)
    return np.tile(circle, len(polars_rad)), np.repeat(np.asarray(polars_rad, float), circle.size), rows


def look(
    parts: SubApertures,
    grid: tuple[Array, Array, NDArray[np.int64]],
    ranges_m: Sequence[float | None],
    delay_ns: float | None,
) -> Look:
    """Scores of a grid, fused over scales: each scale counts as much as the others."""
    azimuth, polar, rows = grid
    scores = score(parts, direction(azimuth, polar), ranges_m, delay_ns).score
    peak = scores.max(axis=(1, 2)).astype(np.float64)
    combined = (scores / peak[:, None, None]).mean(axis=0)
    return Look(azimuth, polar, np.asarray(combined, np.float64), peak, tuple(ranges_m), rows)


def refine(
    parts: SubApertures,
    start: tuple[float, float, float | None],
    peak: Array,
    step_rad: float,
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
    d, log_step = step_rad / 2, _LOG_RANGE_STEP
    norm, result = peak, Focus(azimuth, polar, range_m, 0.0, 0.0)
    for step in range(steps):
        d_azimuth, d_polar = d / max(math.sin(polar), 0.1), d * (3.0 if bounds.planar else 1.0)
        ranges: tuple[float | None, ...] = (None,)
        if range_m is not None:
            ranges = tuple(min(max(range_m * math.exp(i * log_step), _MIN_RANGE_M), _MAX_RANGE_M) for i in (-1, 0, 1))
        scores = _around(parts, azimuth, polar, d_azimuth, d_polar, ranges, delay_ns)
        cube = (scores.score / norm[:, None, None]).mean(axis=0, dtype=np.float64).reshape(3, 3, -1)
        top = np.unravel_index(int(np.argmax(cube)), cube.shape)
        cell = (3 * int(top[0]) + int(top[1]), int(top[2]))
        coherence = float(scores.coherence[0, *cell])
        move = _newton(cube) if cube.shape[2] == 3 else np.array([top[0] - 1.0, top[1] - 1.0, 0.0])
        azimuth += move[0] * d_azimuth
        polar = bounds.keep(float(polar + move[1] * d_polar))
        if range_m is not None:
            range_m = min(max(range_m * math.exp(move[2] * log_step), _MIN_RANGE_M), _MAX_RANGE_M)
        if np.abs(move).max() < 1.0:
            d = max(0.5 * d, _LEAST_BEAM_WIDTHS * beam_rad)
            log_step = max(0.7 * log_step, _LEAST_LOG_RANGE_STEP)
        if step == steps // 2 and coherence > coherent_above:
            parts, norm, delay_ns = parts.whole(), np.ones(1), None
        result = Focus(float(azimuth), polar, range_m, coherence, float(scores.delay_ns[-1, *cell]))
    return result


def _around(
    parts: SubApertures,
    azimuth: float,
    polar: float,
    d_azimuth: float,
    d_polar: float,
    ranges: tuple[float | None, ...],
    delay_ns: float | None,
) -> Scores:
    azimuths = azimuth + d_azimuth * np.repeat([-1.0, 0.0, 1.0], 3)
    polars = polar + d_polar * np.tile([-1.0, 0.0, 1.0], 3)
    return score(parts, direction(azimuths, polars), ranges, delay_ns)


def _newton(cube: Array) -> Array:
    """Offset (3,) of the maximum of the quadratic through (3, 3, 3) points, or of the highest point if it has none."""
    c = cube[1, 1, 1]
    gradient = 0.5 * np.array(
        [cube[2, 1, 1] - cube[0, 1, 1], cube[1, 2, 1] - cube[1, 0, 1], cube[1, 1, 2] - cube[1, 1, 0]]
    )
    hessian = np.diag(
        [
            cube[2, 1, 1] + cube[0, 1, 1] - 2 * c,
            cube[1, 2, 1] + cube[1, 0, 1] - 2 * c,
            cube[1, 1, 2] + cube[1, 1, 0] - 2 * c,
        ]
    )
    hessian[0, 1] = hessian[1, 0] = (cube[2, 2, 1] + cube[0, 0, 1] - cube[2, 0, 1] - cube[0, 2, 1]) / 4
    hessian[0, 2] = hessian[2, 0] = (cube[2, 1, 2] + cube[0, 1, 0] - cube[2, 1, 0] - cube[0, 1, 2]) / 4
    hessian[1, 2] = hessian[2, 1] = (cube[1, 2, 2] + cube[1, 0, 0] - cube[1, 2, 0] - cube[1, 0, 2]) / 4
    values, vectors = np.linalg.eigh(hessian)
    if values.max() >= -1e-9 * np.abs(values).max():
        return np.array(np.unravel_index(int(np.argmax(cube)), cube.shape), float) - 1
    move = -vectors @ ((vectors.T @ gradient) / values)
    size = float(np.abs(move).max())
    return np.asarray(move if size <= _MAX_STEP else move * (_MAX_STEP / size))
