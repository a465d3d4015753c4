"""Fewer packets with the same field: skeletons of the stretches of a path.

In every direction u the packets of a stretch add up to F(u) = sum_k g_k exp(-j 2 pi u . x_k), positions x in
wavelengths of the phase. Over a stretch a few wavelengths long all these steering vectors lie, but for a small rest, in
the span of those of a few of its packets, the skeleton: about two a wavelength and some at the ends, however densely
packets lie. With the right weights w the skeleton alone gives the same field,

    F(u) = sum_i w_i exp(-j 2 pi u . x_i).

The inner product of two steering vectors over the sphere is real and known, K(d) = sin(2 pi d) / (2 pi d) with their
distance d. So the skeleton is found by Cholesky's factors of K with pivots, which takes the worst represented packet
next and knows the mean square rest of each, without any direction being looked at; weights follow from the same
factors. Since only distances enter, a spherical wave, which across a stretch is a few plane ones, is kept as well.

Cheng, Gimbutas, Martinsson, Rokhlin, On the compression of low rank matrices, SIAM J. Sci. Comput. 26, 2005; greedy
choice by a kernel: De Marchi, Schaback, Wendland, Adv. Comput. Math. 23, 2005.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wsr.machine_code import compiled, inner

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]

_LENGTHS: Final = (1.0, 3.0, 8.0)
"""Wavelengths: first short stretches, whose many packets need few members, then long ones of these members, which need
fewer for their length."""
_MOST: Final = (32, 48, 48)
"""Members. A smooth path needs 7, 14 and 27; what shakes needs more, up to where the search is not worth it. Such a
stretch stays as it is, as does one that would keep nearly all, and the rest of a path that has more of these."""
_WORTH: Final = 0.9
_PATIENCE: Final = 2
TOLERANCE: Final = 1e-4
"""Root mean square, over directions, of what is left of a packet's steering vector."""

# Rows of the room to work in, behind the places of a stretch: what is left of each packet, and a column of the kernel.
_LEFT, _COLUMN = 3, 4
# sin(pi r) / (pi r) on |r| <= 1/2 as a polynomial in r^2: Taylor's, error 1e-14.
_S1, _S2, _S3, _S4, _S5, _S6, _S7 = ((-1) ** n * math.pi ** (2 * n) / math.factorial(2 * n + 1) for n in range(1, 8))


def condensed(
    x: Array, channel: Complex, tolerance: float = TOLERANCE, borders: Indices | None = None
) -> tuple[Array, Complex, Indices]:
    """Positions (N, 3) and channels (N, S), N <= M, with the field of packets x (M, 3) in wavelengths of the phase and
    channel (M, S), all finite, in path order. Stretches that have no small skeleton are left as they are.

    `borders` (C + 1,), from 0 to M: runs that no stretch spans; those of the result come last.
    """
    places = np.ascontiguousarray(x.T, np.float64)
    parts = np.ascontiguousarray(np.concatenate([channel.real.T, channel.imag.T]), np.float64)
    runs = np.array([0, len(x)]) if borders is None else borders.copy()
    for length, most in zip(_LENGTHS, _MOST, strict=True):
        packets = places.shape[1]
        room = np.empty((most, packets)), np.empty((5, packets)), np.empty(most, np.int64), np.empty(most)
        count = _condense(places, parts, runs, length, tolerance**2, most, *room)
        places, parts = places[:, :count].copy(), parts[:, :count].copy()
    half = len(parts) // 2
    return places.T, (parts[:half] + 1j * parts[half:]).T, runs


@compiled
def _condense(
    places: Array,
    parts: Array,
    runs: Indices,
    length: float,
    rest: float,
    most: int,
    factor: Array,
    near: Array,
    members: Indices,
    weights: Array,
) -> int:
    """Moves places (3, M) and parts (2 S, M) of the channels of all skeletons to the front; their number. `runs` then
    tells their runs. Room to work in: `factor` (most, M), `near` (5, M), `members` (most,) and `weights` (most,)."""
    count, patience, run = 0, _PATIENCE, 1
    first = runs[0]  # 0, but no constant: else all below is compiled for it once more
    for k in range(1, places.shape[1] + 1):
        if k < runs[run]:
            far = 0.0
            for axis in range(3):
                far += (places[axis, k] - places[axis, first]) * (places[axis, k] - places[axis, first])
            if far <= length * length:
                continue
        size, rank = k - first, 0
        if patience > 0 and size > 1:
            for axis in range(3):
                for i in range(size):
                    near[axis, i] = places[axis, first + i]
            worth = int(_WORTH * size)
            rank = _skeleton(near, size, rest, most if most < worth else worth, factor, members)
            patience = patience - 1 if rank == 0 else (patience + 1 if patience < _PATIENCE else _PATIENCE)
        for i in range(rank if rank > 0 else size):
            for axis in range(3):
                places[axis, count + i] = near[axis, members[i]] if rank > 0 else places[axis, first + i]
        for s in range(parts.shape[0]):
            if rank > 0:
                _weigh(parts, s, first, size, rank, factor, near, members, weights)
            for i in range(rank if rank > 0 else size):
                parts[s, count + i] = weights[i] if rank > 0 else parts[s, first + i]
        count += rank if rank > 0 else size
        first = k
        if k == runs[run]:
            runs[run] = count
            run += 1
    return count


@inner
def _skeleton(near: Array, size: int, rest: float, most: int, factor: Array, members: Indices) -> int:
    """Number of members of one stretch, or 0 where more than `most` would be needed; rows of Cholesky's factor L^T.
    The first rows of `near` are its places."""
    for k in range(size):
        near[_LEFT, k] = 1.0
    for rank in range(most + 1):
        pivot = 0
        for k in range(1, size):
            if near[_LEFT, k] > near[_LEFT, pivot]:
                pivot = k
        if near[_LEFT, pivot] <= rest:
            return rank
        if rank == most:
            break
        x, y, z = near[0, pivot], near[1, pivot], near[2, pivot]
        for k in range(size):
            a, b, c = near[0, k] - x, near[1, k] - y, near[2, k] - z
            near[_COLUMN, k] = _kernel(a * a + b * b + c * c)
        for i in range(rank):
            share = factor[i, pivot]
            for k in range(size):
                near[_COLUMN, k] -= share * factor[i, k]
        scale = 1.0 / math.sqrt(near[_LEFT, pivot])
        for k in range(size):
            value = near[_COLUMN, k] * scale
            factor[rank, k] = value
            near[_LEFT, k] -= value * value
        near[_LEFT, pivot] = 0.0
        members[rank] = pivot
    return 0


@inner
def _weigh(
    parts: Array,
    s: int,
    first: int,
    size: int,
    rank: int,
    factor: Array,
    near: Array,
    members: Indices,
    weights: Array,
) -> None:
    """Weights w of the members: L_m^T w = L^T g, from the last on."""
    for k in range(size):
        near[_COLUMN, k] = parts[s, first + k]
    for i in range(rank - 1, -1, -1):
        value = 0.0
        for k in range(size):
            value += factor[i, k] * near[_COLUMN, k]
        for j in range(i + 1, rank):
            value -= factor[i, members[j]] * weights[j]
        weights[i] = value / factor[i, members[i]]


@inner
def _kernel(square: float) -> float:
    """K of the square of a distance."""
    d = 2.0 * math.sqrt(square) + 1e-15
    turns = np.rint(d)
    r = d - turns
    q = r * r
    sine = r + r * q * (_S1 + q * (_S2 + q * (_S3 + q * (_S4 + q * (_S5 + q * (_S6 + q * _S7))))))
    sign = 1.0 - 2.0 * abs(turns - 2.0 * np.rint(0.5 * turns))
    return float(sign * sine / d)
