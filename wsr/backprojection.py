"""The scores of a whole sphere of directions, in two steps: factorised back-projection.

The path is cut into leaves of a few bins. What a leaf adds up to, relative to its own middle, changes slowly with the
direction: as fast as the leaf is wide. So it is summed on a coarse grid and interpolated, by six points along either
angle, and only the phases of the leaves' middles are those of the fine direction. The field of an aperture of radius R
wavelengths holds angular frequencies up to 2 pi R; a leaf is as many times smaller as there are leaves in line.

Yegulalp, Fast backprojection algorithm for synthetic aperture radar, IEEE Radar Conf. 1999; here for spherical waves of
several ranges, on a grid thinned towards the poles.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsr.kernel import compiled, phasors
from wsr.subapertures import BLOCK, Scores, SubApertures, delay_weight, fuse, path_turns, score_grid, turned_sum

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Indices = NDArray[np.int64]

_LEAF_BINS: Final = 14
_FEWEST_BINS: Final = 6
"""Where leaves are shorter in the mean, by many breaks of the chain of signs, nothing is gained."""
_STEP_RAD: Final = 1.1
"""Of phase, at the edge of the widest leaf, from one coarse direction to the next: six points then interpolate it to
1 %, and the sum over its bins to a twentieth of that."""
_TAPS: Final = 6
_MARGIN: Final = _TAPS // 2
_GAIN: Final = 2.0
"""A coarse grid that is not by so much coarser than the fine one is not worth it."""


class Rows(NamedTuple):
    """Directions in rows of constant polar angle: polar_rad (T,), and where each starts, first (T + 1,). A row's
    azimuths are even over the whole circle, from -pi on."""

    polar_rad: Array
    first: Indices


class _Leaves(NamedTuple):
    borders: Indices
    """(L + 1,) first bin of each, and B."""
    runs: Indices
    """(C + 1,) first leaf of each run of bins, and L."""
    middle: Array32
    """(3, L) in wavelengths."""
    radius: float
    """Of the widest, in wavelengths."""


def score_rows(
    parts: SubApertures, u: Array, rows: Rows, ranges_m: tuple[float | None, ...], delay_ns: float | None
) -> Scores:
    """What `wsr.subapertures.score` gives for the directions u (N, 3) of `rows`, to 0.3 % of the maximum."""
    scales = int(parts.pieces[-1, 0]) + 1
    # A range after the other, whole: slices of one array would have the kernels compiled for other strides.
    shape = (len(ranges_m), scales, len(u))
    coherence, phase = np.empty(shape, np.float32), np.zeros(shape, np.float32)
    leaves, u32 = _leaves(parts), np.ascontiguousarray(u, np.float32)
    arrays = parts.arrays(delay_ns is not None)
    for i, range_m in enumerate(ranges_m):
        reach = 0.0 if range_m is None else range_m / parts.wavelength_m
        step_rad = _coarse_step_rad(leaves, reach, len(u))
        if step_rad is None:
            one, late = coherence[i, :, :, None], phase[i, :, :, None]
            x, x2, h, cuts, pieces, lag, power = arrays
            score_grid(x, x2, h, u32, np.array([reach], np.float32), cuts, pieces, lag, power, one, late)
            continue
        count = math.ceil(math.pi / step_rad)
        _back_project(
            *arrays, u32, rows.polar_rad, rows.first, np.float32(reach), leaves.borders, leaves.runs, leaves.middle,
            math.pi / count, 2 * count, coherence[i], phase[i],
        )  # fmt: skip
    coherence, phase = (np.ascontiguousarray(np.moveaxis(each, 0, 2)) for each in (coherence, phase))
    if delay_ns is None or not parts.lag.size:
        return Scores(coherence, coherence)
    return Scores(coherence * delay_weight(phase, delay_ns), coherence)


def _leaves(parts: SubApertures) -> _Leaves:
    """Runs of bins, each cut evenly into leaves."""
    counts = np.ceil(np.diff(parts.cuts) / _LEAF_BINS).astype(np.int64)
    borders = [
        first + np.arange(count) * (after - first) // count
        for first, after, count in zip(parts.cuts[:-1], parts.cuts[1:], counts, strict=True)
    ]
    starts = np.concatenate(borders)
    sizes = np.diff(starts, append=parts.cuts[-1])
    middle = (np.add.reduceat(parts.x, starts, axis=1) / sizes).astype(np.float32)
    off = parts.x - np.repeat(middle, sizes, axis=1)
    radius = math.sqrt(float((off**2).sum(axis=0).max()))
    return _Leaves(np.append(starts, parts.cuts[-1]), np.append(0, np.cumsum(counts)), middle, radius)


def _coarse_step_rad(leaves: _Leaves, reach: float, directions: int) -> float | None:
    """Of the coarse grid for sources `reach` wavelengths away (0: far), None where each direction by itself is no
    slower. A source that is near sees the leaf nearest to it turn faster."""
    far = float(np.sqrt((leaves.middle**2).sum(axis=0).max()))
    if leaves.borders[-1] < _FEWEST_BINS * leaves.runs[-1] or (reach and reach < 2.0 * far):
        return None
    stretch = reach / (reach - far) if reach else 1.0
    step_rad = _STEP_RAD / (math.tau * max(leaves.radius, 1e-3) * stretch)
    step_rad = min(step_rad, math.pi / 8)
    return step_rad if 2.0 * (math.pi / step_rad + _TAPS) ** 2 * _GAIN < directions else None


@compiled
def _weights(t: float, out: Array32) -> None:
    """Lagrange's, of six points at -2..3, for a place 0 <= t < 1."""
    a, b, c, d, e, f = t + 2.0, t + 1.0, t, t - 1.0, t - 2.0, t - 3.0
    low, high = a * b * c, d * e * f
    out[0] = b * c * high / -120.0
    out[1] = a * c * high / 24.0
    out[2] = a * b * high / -12.0
    out[3] = low * e * f / 12.0
    out[4] = low * d * f / -24.0
    out[5] = low * d * e / 120.0


@compiled
def _back_project(
    x: Array32,
    x2: Array32,
    h: Array32,
    cuts: Indices,
    pieces: Indices,
    lag: NDArray[np.complex64],
    power: float,
    u: Array32,
    polars: Array,
    first: Indices,
    reach: np.float32,
    borders: Indices,
    runs: Indices,
    middle: Array32,
    step: float,
    circle: int,
    coherence: Array32,
    phase: Array32,
) -> None:
    """Coherence and phase (K, N) for one range `reach` in wavelengths; coarse rows `step` apart, with `circle` azimuths
    each."""
    combos, leaves = h.shape[1], borders.size - 1
    width = leaves * combos
    middle2 = np.empty(leaves, np.float32)
    for leaf in range(leaves):
        middle2[leaf] = middle[0, leaf] ** 2 + middle[1, leaf] ** 2 + middle[2, leaf] ** 2
    coarse = _coarse(x, x2, h, reach, borders, middle, middle2, step, circle)
    across, turns = np.empty(leaves, np.float32), np.empty(leaves, np.float32)
    cosine, sine = np.empty(leaves, np.float32), np.empty(leaves, np.float32)
    taps = np.empty(_TAPS, np.float32)
    # The circle goes on at both ends, so that no tap has to be wrapped.
    ring = np.empty((circle + _TAPS, 2, width), np.float32)
    z = np.empty((2, width), np.float32)
    y = np.empty((cuts.size - 1, combos, 2, BLOCK), np.float32)
    room = np.empty((2 * combos + 2, 2, BLOCK), np.float32)
    for row in range(polars.size):
        at = polars[row] / step + _MARGIN
        base = int(at)
        _weights(at - base, taps)
        for q in range(circle):
            for part in range(2):
                for k in range(width):
                    ring[q + 2, part, k] = 0.0
                for tap in range(_TAPS):
                    for k in range(width):
                        ring[q + 2, part, k] += taps[tap] * coarse[base - 2 + tap, q, part, k]
        ring[:2] = ring[circle : circle + 2]
        ring[circle + 2 :] = ring[2:_TAPS]
        count = first[row + 1] - first[row]
        for n in range(first[row], first[row + 1]):
            m = (n - first[row]) % BLOCK
            at = (n - first[row]) * (circle / count)
            base = int(at)
            _weights(at - base, taps)
            for part in range(2):
                for k in range(width):
                    z[part, k] = 0.0
                for tap in range(_TAPS):
                    for k in range(width):
                        z[part, k] += taps[tap] * ring[base + tap, part, k]
            for leaf in range(leaves):
                across[leaf] = u[n, 0] * middle[0, leaf] + u[n, 1] * middle[1, leaf] + u[n, 2] * middle[2, leaf]
            path_turns(across, middle2, reach, turns)
            phasors(turns, cosine, sine)
            for s in range(combos):
                at_s = s * leaves
                for leaf in range(leaves):
                    re, im = z[0, at_s + leaf], z[1, at_s + leaf]
                    z[0, at_s + leaf] = re * cosine[leaf] - im * sine[leaf]
                    z[1, at_s + leaf] = re * sine[leaf] + im * cosine[leaf]
                for run in range(runs.size - 1):
                    for part in range(2):
                        value = z[part, at_s + runs[run]]
                        for leaf in range(runs[run] + 1, runs[run + 1]):
                            value += z[part, at_s + leaf]
                        y[run, s, part, m] = value
            if m == BLOCK - 1 or n == first[row + 1] - 1:
                fuse(y, m + 1, pieces, lag, power, room, coherence[:, n - m : n + 1], phase[:, n - m : n + 1])


@compiled
def _coarse(
    x: Array32,
    x2: Array32,
    h: Array32,
    reach: np.float32,
    borders: Indices,
    middle: Array32,
    middle2: Array32,
    step: float,
    circle: int,
) -> Array32:
    """Sums (P, circle, 2, L S) of each leaf relative to its middle, in rows `step` apart from a few beyond one pole to
    a few beyond the other."""
    bins, combos, leaves = x.shape[1], h.shape[1], borders.size - 1
    rows = int(math.pi / step + 0.5) + 1 + 2 * _MARGIN
    result = np.empty((rows, circle, 2, leaves * combos), np.float32)
    across, turns = np.empty(bins, np.float32), np.empty(bins, np.float32)
    cosine, sine = np.empty(bins, np.float32), np.empty(bins, np.float32)
    off, own = np.empty(leaves, np.float32), np.empty(leaves, np.float32)
    out = np.empty(2, np.float32)
    for p in range(rows):
        polar = (p - _MARGIN) * step
        for q in range(circle):
            azimuth = -math.pi + q * (math.tau / circle)
            ux = np.float32(math.sin(polar) * math.cos(azimuth))
            uy = np.float32(math.sin(polar) * math.sin(azimuth))
            uz = np.float32(math.cos(polar))
            for b in range(bins):
                across[b] = ux * x[0, b] + uy * x[1, b] + uz * x[2, b]
            path_turns(across, x2, reach, turns)
            for leaf in range(leaves):
                off[leaf] = ux * middle[0, leaf] + uy * middle[1, leaf] + uz * middle[2, leaf]
            path_turns(off, middle2, reach, own)
            for leaf in range(leaves):
                for b in range(borders[leaf], borders[leaf + 1]):
                    turns[b] -= own[leaf]
            phasors(turns, cosine, sine)
            for leaf in range(leaves):
                for s in range(combos):
                    turned_sum(h[0, s], h[1, s], cosine, sine, borders[leaf], borders[leaf + 1], out)
                    result[p, q, 0, s * leaves + leaf] = out[0]
                    result[p, q, 1, s * leaves + leaf] = out[1]
    return result
