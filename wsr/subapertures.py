"""The score of directions and ranges: spherical waves, coherent inside sub-apertures, summed in power over them.

For a direction u and a range r (None: far field) the path difference of bin b, relative to the centroid, is

    d_b = |r u - x_b| - r,        y_a(s) = sum_{b in a} h_b(s) exp(+j 2 pi d_b / lambda)

over the bins of a sub-aperture a. At a scale K the path is cut into K sub-apertures of equal numbers of bins, and

    F_K(u, r) = sum_a mean_s |y_a(s)|^2 / (mean |h|^2 sum_a B_a^2),

which is 1 if all bins agree at all subcarriers. tau_K is the delay of y against the packets' own power centroid, from
neighbouring subcarriers; a weight exp(-tau / T) prefers the path that comes first, as the straight one does.

Where the chain of signs broke inside a sub-aperture, the pieces are joined with the sign that adds up in that
direction, longest piece first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wsr.kernel import compiled, phasors
from wsr.ofdm import LAG, UNIT_HZ, Grid

_MAX_DELAY_NS = 60.0
BLOCK = 32
"""Directions that are fused at once: a few vector registers of them, and what is added up stays in the first cache."""
_DELAY_NS_PER_RAD = -1e9 / (2 * math.pi * LAG * UNIT_HZ)

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Scores:
    """score and coherence, each (K, N, R): scales, directions, ranges. The score is the coherence F times the weight
    for the delay."""

    score: Array32
    coherence: Array32


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SubApertures:
    """Bins in the form the kernel takes. Make with `sub_apertures`."""

    x: Array32
    """(3, B) about the centroid, in wavelengths (half of them for the product)."""
    h: Array32
    """(2, S, B): real and imaginary parts."""
    wavelength_m: float
    lag: NDArray[np.complex64]
    """(S, S): sum over subcarriers a lag apart of their product, as a form in y. (0, 0) without delays."""
    cuts: Indices
    """(C + 1,) first bin of each run, and B. Runs are never split."""
    pieces: Indices
    """(P, 5): scale, sub-aperture, first run, run after the last, bins; of one segment each, longest first."""
    power: float
    """mean over subcarriers and bins of |h|^2, times subcarriers."""

    def arrays(self, delays: bool) -> tuple[Array32, Array32, Array32, Indices, Indices, NDArray[np.complex64], float]:
        """What `score_grid` takes first, with an empty `lag` without `delays`."""
        lag = self.lag if delays else np.zeros((0, 0), np.complex64)
        return self.x, (self.x**2).sum(axis=0), self.h, self.cuts, self.pieces, lag, self.power

    def whole(self) -> SubApertures:
        """The same bins at the scale 1 alone, which has to be the first of the scales."""
        return replace(self, pieces=self.pieces[self.pieces[:, 0] == 0])


def sub_apertures(
    p_m: Array,
    channel: Complex,
    segment: Indices,
    wavelength_m: float,
    scales: Sequence[int],
    resign: bool = True,
    share: float = 1.0,
    grid: Grid | None = None,
) -> SubApertures:
    """Bins p (B, 3), h (B, S) with the number of each one's segment (B,), cut at each of `scales` into so many parts.

    Without a `grid` of the subcarriers there are no delays. `wavelength_m` is of the phase: half of the carrier's for
    the round-trip product. With a `share` under 1 the subcarriers are reduced to the fewest combinations that hold this
    share of the power: paths differ by tens of nanoseconds, so few subcarriers are independent, and the rest is noise.
    """
    bins = len(p_m)
    basis = _basis(channel, share)
    values = channel if basis is None else channel @ basis.conj()
    x = (p_m - p_m.mean(axis=0)) / wavelength_m
    borders = [np.arange(parts) * bins // parts for parts in scales]
    cuts = np.unique(np.concatenate([*borders, np.flatnonzero(np.diff(segment, prepend=segment[0]))]))
    owners = np.array([np.searchsorted(border, cuts, "right") - 1 for border in borders])
    return SubApertures(
        x=np.ascontiguousarray(x.T, np.float32),
        h=np.ascontiguousarray(np.stack([values.real.T, values.imag.T]), np.float32),
        wavelength_m=wavelength_m,
        lag=_lag_form(grid, basis),
        cuts=np.append(cuts, bins),
        pieces=_pieces(owners, np.diff(cuts, append=bins), segment[cuts], resign),
        power=float((np.abs(channel) ** 2).sum(axis=1).mean()),
    )


def score(parts: SubApertures, u: Array, ranges_m: Sequence[float | None], delay_ns: float | None) -> Scores:
    """Scores of directions u (N, 3) at each range; no weight for the delay if `delay_ns` is None."""
    scales = int(parts.pieces[-1, 0]) + 1
    shape = (scales, len(u), len(ranges_m))
    coherence, phase = np.empty(shape, np.float32), np.zeros(shape, np.float32)
    ranges = np.array([0.0 if r is None else r / parts.wavelength_m for r in ranges_m], np.float32)
    x, x2, h, cuts, pieces, lag, power = parts.arrays(delay_ns is not None)
    score_grid(x, x2, h, np.ascontiguousarray(u, np.float32), ranges, cuts, pieces, lag, power, coherence, phase)
    if delay_ns is None or not lag.size:
        return Scores(coherence, coherence)
    return Scores(coherence * delay_weight(phase, delay_ns), coherence)


def delay_weight(phase_rad: Array32, delay_ns: float) -> Array32:
    """exp(-delay / `delay_ns`) for phases, of any shape, of the product of subcarriers a lag apart."""
    late_ns = np.minimum(np.maximum(phase_rad * _DELAY_NS_PER_RAD, -_MAX_DELAY_NS), _MAX_DELAY_NS)
    weight: Array32 = np.exp(late_ns * (-1.0 / delay_ns))
    return weight


def _basis(channel: Complex, share: float) -> Complex | None:
    """Principal combinations (S, R) of subcarriers, orthonormal, None for all."""
    if share >= 1.0 or channel.shape[1] == 1:
        return None
    values, vectors = np.linalg.eigh(channel.T @ channel.conj())
    held = np.cumsum(values[::-1]) / values.sum()
    return np.asarray(vectors[:, ::-1][:, : int(np.searchsorted(held, share)) + 1])


def _lag_form(grid: Grid | None, basis: Complex | None) -> NDArray[np.complex64]:
    """Q with sum_k y(k + lag) y(k)^* = sum_ab z_a z_b^* Q_ab where y = B z."""
    if grid is None or not grid.first.size:
        return np.zeros((0, 0), np.complex64)
    full = np.eye(grid.size, dtype=np.complex128) if basis is None else basis
    return np.asarray(full[grid.second].T @ full[grid.first].conj(), np.complex64)


@compiled
def _pieces(owners: Indices, sizes: Indices, segment: Indices, resign: bool) -> Indices:
    """`SubApertures.pieces` of C runs: which sub-aperture each belongs to at each scale (K, C), so many bins (C,), of
    the segment (C,). Both numbers do not decrease."""
    scales, runs = owners.shape
    rows, count = np.empty((scales * runs, 5), np.int64), 0
    for scale in range(scales):
        group, top, first = 0, count, 0
        for run in range(runs):
            owner, last = owners[scale, run], run == runs - 1
            if not last and owners[scale, run + 1] == owner and segment[run + 1] == segment[run]:
                continue
            size, at = sizes[first : run + 1].sum(), count
            while at > top and rows[at - 1, 4] < size:
                rows[at] = rows[at - 1]
                at -= 1
            rows[at, 0], rows[at, 2], rows[at, 3], rows[at, 4] = scale, first, run + 1, size
            count, first = count + 1, run + 1
            if last or owners[scale, run + 1] != owner:
                for at in range(top, count):
                    rows[at, 1] = group
                    group += not resign
                group += resign
                top = count
    return rows[:count].copy()


@compiled
def score_grid(
    x: Array32,
    x2: Array32,
    h: Array32,
    u: Array32,
    ranges: Array32,
    cuts: Indices,
    pieces: Indices,
    lag: NDArray[np.complex64],
    power: float,
    coherence: Array32,
    phase: Array32,
) -> None:
    """Coherence, and phase of the lagged product if there is a `lag`, (K, N, R) each, of directions u (N, 3) and ranges
    (R,) in wavelengths, 0 for the far field. What comes first is `SubApertures.arrays`."""
    bins, combos = x.shape[1], h.shape[1]
    across = np.empty(bins, np.float32)
    turns = np.empty(bins, np.float32)
    cosine = np.empty(bins, np.float32)
    sine = np.empty(bins, np.float32)
    width = min(BLOCK, u.shape[0])
    y = np.empty((cuts.size - 1, combos, 2, width), np.float32)
    room = np.empty((2 * combos + 2, 2, width), np.float32)
    for i in range(ranges.size):
        for begin in range(0, u.shape[0], width):
            count = min(width, u.shape[0] - begin)
            for m in range(count):
                n = begin + m
                for b in range(bins):
                    across[b] = u[n, 0] * x[0, b] + u[n, 1] * x[1, b] + u[n, 2] * x[2, b]
                path_turns(across, x2, ranges[i], turns)
                phasors(turns, cosine, sine)
                for run in range(cuts.size - 1):
                    for s in range(combos):
                        turned_sum(h[0, s], h[1, s], cosine, sine, cuts[run], cuts[run + 1], y[run, s, :, m])
            after = begin + count
            fuse(y, count, pieces, lag, power, room, coherence[:, begin:after, i], phase[:, begin:after, i])


@compiled
def path_turns(across: Array32, x2: Array32, r: np.float32, turns: Array32) -> None:
    """d = |r u - x| - r without cancellation: (x^2 - 2 r u.x) / (sqrt(r^2 - 2 r u.x + x^2) + r); r = 0: -u.x."""
    if r == 0.0:
        for b in range(across.size):
            turns[b] = -across[b]
        return
    two = np.float32(2.0)
    zero = np.float32(0.0)
    for b in range(across.size):
        more = x2[b] - two * r * across[b]
        turns[b] = more / (np.sqrt(max(r * r + more, zero)) + r)


@compiled
def turned_sum(re: Array32, im: Array32, cosine: Array32, sine: Array32, first: int, after: int, out: Array32) -> None:
    """Sum of (re + j im)(cosine + j sine): the inner loop."""
    a = b = np.float32(0.0)
    for k in range(first, after):
        a += re[k] * cosine[k] - im[k] * sine[k]
        b += re[k] * sine[k] + im[k] * cosine[k]
    out[0] = a
    out[1] = b


@compiled
def fuse(
    y: Array32,
    count: int,
    pieces: Indices,
    lag: NDArray[np.complex64],
    power: float,
    room: Array32,
    coherence: Array32,
    phase: Array32,
) -> None:
    """Coherence and phase (K, N) of the lagged product at each scale, from the sums (C, S, 2, W) of the `count` = N
    directions that come first. Vector lanes run over directions. `room` is (2 S + 2, 2, W), for what is added up."""
    combos = y.shape[1]
    total, piece = room[:combos], room[combos : 2 * combos]
    match, energy, lagged = room[2 * combos, 0], room[2 * combos, 1], room[2 * combos + 1]
    total[:], energy[:], lagged[:] = 0.0, 0.0, 0.0
    last = pieces.shape[0] - 1
    squares = size = np.float32(0.0)
    for p in range(pieces.shape[0]):
        match[:] = 0.0
        for s in range(combos):
            for part in range(2):
                _add_runs(y[:, s, part], pieces[p, 2], pieces[p, 3], count, piece[s, part], total[s, part], match)
        for s in range(combos):
            for part in range(2):
                for m in range(count):
                    total[s, part, m] += piece[s, part, m] if match[m] >= 0 else -piece[s, part, m]
        size += np.float32(pieces[p, 4])
        new_scale = p == last or pieces[p + 1, 0] != pieces[p, 0]
        if not new_scale and pieces[p + 1, 1] == pieces[p, 1]:
            continue
        for s in range(combos):
            for m in range(count):
                energy[m] += total[s, 0, m] ** 2 + total[s, 1, m] ** 2
        for a in range(lag.shape[0]):
            for b in range(lag.shape[0]):
                _add_lagged(total[a], total[b], lag[a, b].real, lag[a, b].imag, count, lagged)
        squares += size * size
        size = np.float32(0.0)
        total[:] = 0.0
        if new_scale:
            scale = np.float32(1.0) / (np.float32(power) * squares)
            for m in range(count):
                coherence[pieces[p, 0], m] = energy[m] * scale
            if lag.shape[0] > 0:
                _angles(lagged, count, match)
                for m in range(count):
                    phase[pieces[p, 0], m] = match[m]
            energy[:], lagged[:] = 0.0, 0.0
            squares = np.float32(0.0)


@compiled
def _add_runs(y: Array32, first: int, after: int, count: int, piece: Array32, total: Array32, match: Array32) -> None:
    """The sum of some runs (C, W), and how it matches what there is."""
    for m in range(count):
        piece[m] = y[first, m]
    for run in range(first + 1, after):
        for m in range(count):
            piece[m] += y[run, m]
    for m in range(count):
        match[m] += piece[m] * total[m]


@compiled
def _add_lagged(a: Array32, b: Array32, re: np.float32, im: np.float32, count: int, lagged: Array32) -> None:
    """Adds a b^* (re + j im), for complex numbers (2, W)."""
    for m in range(count):
        product_re = a[0, m] * b[0, m] + a[1, m] * b[1, m]
        product_im = a[1, m] * b[0, m] - a[0, m] * b[1, m]
        lagged[0, m] += product_re * re - product_im * im
        lagged[1, m] += product_re * im + product_im * re


# arctan(a) / a on 0 <= a <= 1 as a polynomial in a^2: minimax, error 4e-8 rad before rounding.
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7 = (
    np.float32(c)
    for c in (
        0.99999933558,
        -0.33329860775,
        0.19946565506,
        -0.1390862868,
        0.096421948193,
        -0.055912289341,
        0.021862930039,
        -0.0040545590533,
    )
)


@compiled
def _angles(xy: Array32, count: int, out: Array32) -> None:
    """arctan2 of (2, W), which the mathematical library has for one number at a time only."""
    zero, one, half, quarter = np.float32(0.0), np.float32(1.0), np.float32(math.pi), np.float32(math.pi / 2)
    for m in range(count):
        x, y = xy[0, m], xy[1, m]
        ax, ay = abs(x), abs(y)
        top = ax if ax > ay else ay
        ratio = (ay if ax > ay else ax) / (top if top > zero else one)
        q = ratio * ratio
        value = _A4 + q * (_A5 + q * (_A6 + q * _A7))
        value = ratio * (_A0 + q * (_A1 + q * (_A2 + q * (_A3 + q * value))))
        value = quarter - value if ay > ax else value
        value = half - value if x < zero else value
        out[m] = -value if y < zero else value
