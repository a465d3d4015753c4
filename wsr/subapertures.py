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

from wsr.kernel import phasor
from wsr.machine_code import compiled, inner, shared
from wsr.ofdm import LAG, UNIT_HZ, Grid
from wsr.skeleton import condensed

_MAX_DELAY_NS = 60.0
BLOCK = 64
"""Directions that are fused at once: a few vector registers of them, and what is added up stays in the first cache."""
_TOLERANCE = 1e-3
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
        return self.x, (self.x**2).sum(axis=0), self.h[None], self.cuts, self.pieces, lag, self.power

    def condensed(self) -> SubApertures:
        """The same with skeletons in the place of runs of bins: scores within 1e-3 of the maximum."""
        return self.with_channels((self.h[0] + 1j * self.h[1]).T)[0]

    def with_channels(self, channels: Complex) -> list[SubApertures]:
        """Condensed parts (T,) that share their bins, one for every S columns of channels (B, T S)."""
        x, h, cuts = condensed(self.x.T.astype(np.float64), channels, _TOLERANCE, self.cuts)
        places, size = np.ascontiguousarray(x.T, np.float32), self.h.shape[1]
        parts = np.stack([h.real.T, h.imag.T]).astype(np.float32).reshape(2, -1, size, len(h))
        return [replace(self, x=places, h=parts[:, t].copy(), cuts=cuts) for t in range(parts.shape[1])]

    def whole(self) -> SubApertures:
        """The same bins at the scale 1 alone, which has to be the first of the scales."""
        return replace(self, pieces=self.pieces[self.pieces[:, 0] == 0])


def sub_apertures(
    p_m: Array,
    channel: Complex,
    segment: Indices,
    wavelength_m: float,
    *,
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
    basis = _basis(channel, share)
    values = channel if basis is None else channel @ basis.conj()
    x = (p_m - p_m.mean(axis=0)) / wavelength_m
    cuts, pieces = cut_up(segment, scales, resign)
    return SubApertures(
        x=np.ascontiguousarray(x.T, np.float32),
        h=np.ascontiguousarray(np.stack([values.real.T, values.imag.T]), np.float32),
        wavelength_m=wavelength_m,
        lag=_lag_form(grid, basis),
        cuts=cuts,
        pieces=pieces,
        power=float((np.abs(channel) ** 2).sum(axis=1).mean()),
    )


def cut_up(segment: Indices, scales: Sequence[int], resign: bool = True) -> tuple[Indices, Indices]:
    """`SubApertures.cuts` and `.pieces` of bins with these numbers of segments (B,)."""
    bins = len(segment)
    borders = [np.arange(parts) * bins // parts for parts in scales]
    cuts = np.unique(np.concatenate([*borders, 1 + np.flatnonzero(segment[1:] != segment[:-1])]))
    owners = np.array([border.searchsorted(cuts, "right") - 1 for border in borders])
    ends = np.append(cuts, bins)
    return ends, _pieces(owners, ends[1:] - cuts, segment[cuts], resign)


def score(parts: SubApertures, u: Array, ranges_m: Sequence[float | None], delay_ns: float | None) -> Scores:
    """Scores of directions u (N, 3) at each range; no weight for the delay if `delay_ns` is None."""
    return score_together([parts], u, ranges_m, delay_ns)[0]


def score_together(
    links: Sequence[SubApertures], u: Array, ranges_m: Sequence[float | None], delay_ns: float | None
) -> list[Scores]:
    """The same for parts that share their bins, cuts and pieces, with steering vectors made once for all."""
    first = links[0]
    scales = int(first.pieces[-1, 0]) + 1
    shape = (len(links), scales, len(u) * len(ranges_m))
    coherence, phase = np.empty(shape, np.float32), np.zeros(shape, np.float32)
    inverse = np.array([0.0 if r is None else first.wavelength_m / r for r in ranges_m], np.float32)
    x, x2, h, cuts, pieces, lag, power = first.arrays(delay_ns is not None)
    if len(links) > 1:
        h = np.stack([link.h for link in links])
    directions = np.ascontiguousarray(u, np.float32)
    if len(ranges_m) != 1:
        directions = np.tile(directions, (len(ranges_m), 1))
    score_grid(x, x2, h, cuts, pieces, lag, power, directions, inverse.repeat(len(u)), coherence, phase)
    apart = (len(links), scales, len(ranges_m), len(u))
    f, late = (each.reshape(apart).swapaxes(2, 3) for each in (coherence, phase))
    if delay_ns is None or not lag.size:
        return [Scores(each, each) for each in f]
    return [Scores(each * delay_weight(rad, delay_ns), each) for each, rad in zip(f, late, strict=True)]


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
            size, at = 0, count
            for one in range(first, run + 1):
                size += sizes[one]
            while at > top and rows[at - 1, 4] < size:
                for field in range(5):
                    rows[at, field] = rows[at - 1, field]
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


@shared
def score_grid(
    x: Array32,
    x2: Array32,
    h: Array32,
    cuts: Indices,
    pieces: Indices,
    lag: NDArray[np.complex64],
    power: float,
    u: Array32,
    inverse: Array32,
    coherence: Array32,
    phase: Array32,
) -> None:
    """Coherence, and phase of the lagged product if there is a `lag`, (T, K, N) each, of directions u (N, 3) with
    inverse ranges (N,) a wavelength, 0 for the far field. What comes first is `SubApertures.arrays`, h for T of them.

    Vector lanes run over directions, in blocks.
    """
    links, combos = h.shape[0], h.shape[2]
    longest = 0
    for run in range(cuts.size - 1):
        longest = max(longest, cuts[run + 1] - cuts[run])
    # What is left over of the last block stands for any direction.
    lanes = np.zeros((4, BLOCK), np.float32)
    steering = np.empty((longest, 2, BLOCK), np.float32)
    y = np.empty((links, cuts.size - 1, combos * 2 * BLOCK), np.float32)
    room = np.empty((2, combos * 2 * BLOCK), np.float32)
    result = np.empty((2, coherence.shape[1], BLOCK), np.float32)
    for begin in range(0, u.shape[0], BLOCK):
        count = min(BLOCK, u.shape[0] - begin)
        for m in range(count):
            for axis in range(3):
                lanes[axis, m] = u[begin + m, axis]
            lanes[3, m] = inverse[begin + m]
        for run in range(cuts.size - 1):
            first = cuts[run]
            for b in range(first, cuts[run + 1]):
                _steer(lanes, x[0, b], x[1, b], x[2, b], x2[b], steering[b - first])
            for link in range(links):
                for s in range(combos):
                    at = s * 2 * BLOCK
                    _add_up(h[link, 0, s], h[link, 1, s], first, cuts[run + 1], steering, y[link, run, at:])
        for link in range(links):
            _fuse(y[link], pieces, lag, power, room[0], room[1], result)
            for scale in range(coherence.shape[1]):
                for m in range(count):
                    coherence[link, scale, begin + m] = result[0, scale, m]
                    phase[link, scale, begin + m] = result[1, scale, m]


@inner
def _steer(lanes: Array32, x: np.float32, y: np.float32, z: np.float32, square: np.float32, out: Array32) -> None:
    """exp(+j 2 pi d) (2, W) of one bin: d = |r u - x| - r without cancellation, with q = 1 / r
    (q x^2 - 2 u.x) / (sqrt(1 - 2 q u.x + q^2 x^2) + 1)."""
    one, two, zero = np.float32(1.0), np.float32(2.0), np.float32(0.0)
    for m in range(BLOCK):
        q = lanes[3, m]
        more = q * square - two * (lanes[0, m] * x + lanes[1, m] * y + lanes[2, m] * z)
        turns = more / (np.sqrt(max(one + q * more, zero)) + one)
        out[0, m], out[1, m] = phasor(turns - np.rint(turns))


@inner
def _add_up(re: Array32, im: Array32, first: int, after: int, steering: Array32, out: Array32) -> None:
    """Sums (2, W) of h times steering (B, 2, W) over some bins: the inner loop."""
    for m in range(2 * BLOCK):
        out[m] = 0.0
    for b in range(first, after):
        a, c, at = re[b], im[b], steering[b - first]
        for m in range(BLOCK):
            out[m] += a * at[0, m] - c * at[1, m]
            out[m + BLOCK] += a * at[1, m] + c * at[0, m]


@inner
def _fuse(
    y: Array32,
    pieces: Indices,
    lag: NDArray[np.complex64],
    power: float,
    total: Array32,
    piece: Array32,
    result: Array32,
) -> None:
    """Coherence and phase of the lagged product (2, K, W) at each scale, from the sums (C, 2 S W) of runs. Vector lanes
    run over directions. `total` and `piece` (2 S W,) are room to work in."""
    width, last = y.shape[1], pieces.shape[0] - 1
    match, energy = np.empty(BLOCK, np.float32), np.zeros(BLOCK, np.float32)
    lagged = np.zeros(2 * BLOCK, np.float32)
    squares = size = np.float32(0.0)
    fresh = True
    for p in range(last + 1):
        into = total if fresh else piece
        into[:] = 0.0
        for run in range(pieces[p, 2], pieces[p, 3]):
            more = y[run]
            for i in range(width):
                into[i] += more[i]
        if not fresh:
            match[:] = 0.0
            for at in range(0, width, BLOCK):
                _add_products(piece[at:], total[at:], match)
            for at in range(0, width, BLOCK):
                _join(piece[at:], match, total[at:])
        size += np.float32(pieces[p, 4])
        new_scale = p == last or pieces[p + 1, 0] != pieces[p, 0]
        fresh = new_scale or pieces[p + 1, 1] != pieces[p, 1]
        if not fresh:
            continue
        for at in range(0, width, BLOCK):
            _add_products(total[at:], total[at:], energy)
        for a in range(lag.shape[0]):
            for b in range(lag.shape[0]):
                _add_lagged(total[2 * BLOCK * a :], total[2 * BLOCK * b :], lag[a, b].real, lag[a, b].imag, lagged)
        squares += size * size
        size = np.float32(0.0)
        if new_scale:
            scale = np.float32(1.0) / (np.float32(power) * squares)
            for m in range(BLOCK):
                result[0, pieces[p, 0], m] = energy[m] * scale
            if lag.shape[0] > 0:
                _angles(lagged, result[1, pieces[p, 0]])
            energy[:], lagged[:] = 0.0, 0.0
            squares = np.float32(0.0)


@inner
def _add_products(a: Array32, b: Array32, out: Array32) -> None:
    """Adds a b (W,). Views that begin where lanes do, here and below: with indices that might be negative the compiler
    gathers lanes one by one, which takes a third of the whole search."""
    for m in range(BLOCK):
        out[m] += a[m] * b[m]


@inner
def _join(piece: Array32, match: Array32, total: Array32) -> None:
    """Adds a piece (W,) with the sign that matches."""
    for m in range(BLOCK):
        total[m] += piece[m] if match[m] >= 0 else -piece[m]


@inner
def _add_lagged(a: Array32, b: Array32, re: np.float32, im: np.float32, lagged: Array32) -> None:
    """Adds a b^* (re + j im), for complex numbers (2 W,), real parts first."""
    for m in range(BLOCK):
        product_re = a[m] * b[m] + a[m + BLOCK] * b[m + BLOCK]
        product_im = a[m + BLOCK] * b[m] - a[m] * b[m + BLOCK]
        lagged[m] += product_re * re - product_im * im
        lagged[m + BLOCK] += product_re * im + product_im * re


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


@inner
def _angles(xy: Array32, out: Array32) -> None:
    """arctan2 of (2 W,), which the mathematical library has for one number at a time only."""
    zero, one, half, quarter = np.float32(0.0), np.float32(1.0), np.float32(math.pi), np.float32(math.pi / 2)
    for m in range(BLOCK):
        x, y = xy[m], xy[m + BLOCK]
        ax, ay = abs(x), abs(y)
        top = ax if ax > ay else ay
        ratio = (ay if ax > ay else ax) / (top if top > zero else one)
        q = ratio * ratio
        value = _A4 + q * (_A5 + q * (_A6 + q * _A7))
        value = ratio * (_A0 + q * (_A1 + q * (_A2 + q * (_A3 + q * value))))
        value = quarter - value if ay > ax else value
        value = half - value if x < zero else value
        out[m] = -value if y < zero else value
