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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wsr.ofdm import Grid
from wsr.search import AZIMUTH, BLOCK, COHERENCE, DELAY_NS, DELAY_NS_PER_RAD, INVERSE, MAX_DELAY_NS, POLAR, search
from wsr.skeleton import condensed

_TOLERANCE = 1e-3

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
    lag: Array32
    """(2, S, S): real and imaginary part of the sum over subcarriers a lag apart of their product, as a form in y.
    (2, 0, 0) without delays."""
    cuts: Indices
    """(C + 1,) first bin of each run, and B. Runs are never split."""
    pieces: Indices
    """(P, 5): scale, sub-aperture, first run, run after the last, bins; of one segment each, longest first."""
    power: float
    """mean over subcarriers and bins of |h|^2, times subcarriers."""

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
    first, count = links[0], len(u) * len(ranges_m)
    inverse = np.array([0.0 if r is None else first.wavelength_m / r for r in ranges_m], np.float32)
    # What is left over of the last block stands for any direction.
    lanes = np.zeros((-(-count // BLOCK) * BLOCK, 4), np.float32)
    lanes[:count].reshape(len(ranges_m), len(u), 4)[:, :, :3] = u
    lanes[:count, 3] = inverse.repeat(len(u))
    blocks = lanes.reshape(-1, BLOCK, 4).transpose(0, 2, 1).reshape(-1, 4 * BLOCK)
    found = _searched(links, blocks, delay_ns is not None, np.zeros(1 + DELAY_NS), np.ones(1), 0)
    scales = found.shape[2]
    every = found.reshape(-1, len(links), scales, 2, BLOCK).transpose(3, 1, 2, 0, 4)
    every = every.reshape(2, len(links), scales, -1)[..., :count]
    f, late = every.reshape(2, len(links), scales, len(ranges_m), len(u)).swapaxes(3, 4)
    if delay_ns is None or not first.lag.size:
        return [Scores(each, each) for each in f]
    return [Scores(each * delay_weight(rad, delay_ns), each) for each, rad in zip(f, late, strict=True)]


def climbed(
    parts: SubApertures, state: Sequence[float], peak: Array, delays: bool, steps: int
) -> tuple[float, float, float, float]:
    """Azimuth, polar angle, inverse range a wavelength (0: far field, and stays so) and coherence after so many steps
    of `wsr.search.search`, which names the numbers of `state`, with scores over their `peak` (K,)."""
    climb = np.array(state)
    _searched([parts], np.zeros((1, 4 * BLOCK), np.float32), delays, climb, peak.copy(), steps)
    return float(climb[AZIMUTH]), float(climb[POLAR]), float(climb[INVERSE]), float(climb[COHERENCE])


def _searched(
    links: Sequence[SubApertures], blocks: Array32, delays: bool, climb: Array, peak: Array, steps: int
) -> Array32:
    """What `wsr.search.search` finds, (N, T, K, 2 W)."""
    first, runs = links[0], len(links[0].cuts) - 1
    h = first.h[None] if len(links) == 1 else np.stack([link.h for link in links])
    combos = h.shape[2]
    found = np.empty((len(blocks), len(links), int(first.pieces[-1, 0]) + 1, 2 * BLOCK), np.float32)
    steering = np.empty((int(np.diff(first.cuts).max()), 2 * BLOCK), np.float32)
    y, total = np.empty((len(links), runs, combos, 2 * BLOCK), np.float32), np.empty((combos, 4 * BLOCK), np.float32)
    x = np.concatenate([first.x, (first.x**2).sum(axis=0)[None]])
    lag = first.lag if delays else first.lag[:, :0, :0].copy()
    room = steering, y, total, np.empty(4 * BLOCK, np.float32), climb, peak, np.empty(27), np.empty((3, 4)), np.empty(3)
    search(x, h, first.cuts, first.pieces, lag, first.power, blocks, found, *room, steps)
    return found


def delay_weight(phase_rad: Array32, delay_ns: float) -> Array32:
    """exp(-delay / `delay_ns`) for phases, of any shape, of the product of subcarriers a lag apart."""
    late_ns = np.minimum(np.maximum(phase_rad * DELAY_NS_PER_RAD, -MAX_DELAY_NS), MAX_DELAY_NS)
    weight: Array32 = np.exp(late_ns * (-1.0 / delay_ns))
    return weight


def _basis(channel: Complex, share: float) -> Complex | None:
    """Principal combinations (S, R) of subcarriers, orthonormal, None for all."""
    if share >= 1.0 or channel.shape[1] == 1:
        return None
    values, vectors = np.linalg.eigh(channel.T @ channel.conj())
    held = np.cumsum(values[::-1]) / values.sum()
    return np.asarray(vectors[:, ::-1][:, : int(np.searchsorted(held, share)) + 1])


def _lag_form(grid: Grid | None, basis: Complex | None) -> Array32:
    """Q (2, S, S) with sum_k y(k + lag) y(k)^* = sum_ab z_a z_b^* Q_ab where y = B z."""
    if grid is None or not grid.first.size:
        return np.zeros((2, 0, 0), np.float32)
    full = np.eye(grid.size, dtype=np.complex128) if basis is None else basis
    form = full[grid.second].T @ full[grid.first].conj()
    return np.stack([form.real, form.imag]).astype(np.float32)


def _pieces(owners: Indices, sizes: Indices, segment: Indices, resign: bool) -> Indices:
    """`SubApertures.pieces` of C runs: which sub-aperture each belongs to at each scale (K, C), so many bins (C,), of
    the segment (C,). Both numbers do not decrease."""
    scales, runs = owners.shape
    scale, first = np.nonzero((np.diff(owners, prepend=-1) != 0) | (np.diff(segment, prepend=-1) != 0))
    # What begins next, or the end of the path, where the next scale begins.
    after = np.append((scale * runs + first)[1:], scales * runs) - scale * runs
    before = np.append(0, np.cumsum(sizes))
    size, owner = before[after] - before[first], owners[scale, first]
    longest_first = np.lexsort((-size, owner, scale))
    another = (np.diff(owner, prepend=-1) != 0) | (np.diff(scale, prepend=-1) != 0) | (not resign)
    group = np.cumsum(another) - 1
    group -= group[np.searchsorted(scale, scale)]
    return np.stack([scale, group, first[longest_first], after[longest_first], size[longest_first]], axis=1)
