"""The one-way channel from both directions of an exchange.

Through one reciprocal channel h both ends measure h times an unknown phase and delay of their own,

    H_f = h exp(+j (a + b k) / 2),    H_r = h exp(-j (a + b k) / 2)

over the frequency k, once the common delay is left aside. a and b come from H_f H_r^*, so h is known but for its
sign: h^2 = H_f H_r. With half the phase of the product a direction has half as many side lobes, noise of the two ends
is averaged instead of multiplied, and several paths add up as fields do. The signs are chained from packet to packet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.kernel import phasor
from wsr.machine_code import compiled, inner
from wsr.ofdm import Grid, known

_LANES = 16
_STEPS = 2
_TURN = np.float32(1 / (2 * math.pi))
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
# Rows of the room to work in.
_RE, _IM, _COS, _SIN, _F_RE, _F_IM, _R_RE, _R_IM, _WEIGHT, _AWAY = range(10)
_LEAST = np.float32(1e-18)
# A residual frequency of the one-way phase, from motion and what is left of the carrier offset, is followed with this
# time constant: a few packets, and much less than a robot needs to turn.
_RATE_TIME_S = 0.03
_MAX_SKIPPED = 3
# Over a gap this short the rate tells the root of four, however far the robot went: at 3 m/s2 it errs by 2.4 mm.
_FORETOLD_S = 0.04

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Complex64 = NDArray[np.complex64]


@dataclass(frozen=True, slots=True)
class ChainLimits:
    """When the chain of signs goes on, skips a packet, or starts a new segment. Lengths in metres.

    A step longer than `far_m` leaves the sign unknown (a half turn of the one-way phase is half a wavelength); so does
    one longer than `near_m` whose phase fits neither sign well. A packet whose phase lies more than acos(min_cosine)
    off both signs is dropped if `gate`, up to three in a row.
    """

    far_m: float
    near_m: float
    min_cosine: float = 0.7
    gate: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Folded:
    """Both directions of M packets made one."""

    channel: Complex64
    """h (M, S), of unit mean power and unknown sign."""
    reciprocity: Array32
    """(M,), 1 where both ends saw the same."""
    centre: Complex64
    """(M,) product of the two, of unit mean power each, at the channel centre, without its delay."""
    amplitude: Array32
    """(M,) geometric mean of the two ends' amplitudes, in the receivers' own units."""


def fold(forward: Complex64, reverse: Complex64, grid: Grid | None = None) -> Folded:
    """The one-way channel from both directions (M, S)."""
    on = known(forward.shape[1], grid)
    packets = len(forward)
    channel, centre = np.empty(forward.shape, np.complex64), np.empty((packets, 1), np.complex64)
    told = np.empty((2, packets), np.float32)
    subcarriers = _subcarriers(on)
    _fold(_parts(forward), _parts(reverse), *subcarriers, _parts(channel), _parts(centre), told, _room(on))
    return Folded(channel, told[0], centre[:, 0], told[1])


def without_delay(
    channel: NDArray[np.complexfloating], turn_rad: Array | None = None, grid: Grid | None = None
) -> Complex64:
    """The same (M, S) with the delay of each packet's power centroid taken out and each packet turned by `turn_rad`
    (M,)."""
    on = known(channel.shape[1], grid)
    result = np.array(channel, np.complex64, order="C")
    turns = np.zeros(len(channel)) if turn_rad is None else turn_rad
    _take_delay_out(_parts(result), *_subcarriers(on), turns.astype(np.float32, order="C"), _room(on))
    return result


def chain(
    channel: NDArray[np.complexfloating], t_s: Array, p_m: Array, limits: ChainLimits, *, grid: Grid | None = None
) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Signs (M,) of +-1 that make h continuous, which packets to keep, and the segment each belongs to.

    Between packets, the phase of h h_last^* over all subcarriers, less delay and less the phase that its smoothed rate
    predicts, says whether the sign flipped.
    """
    quarters, keep, segment = _chained(channel, t_s, p_m, limits, grid=grid, roots=2)
    return np.asarray(1.0 - quarters, np.float64), keep, segment


def chain_quarters(
    channel: NDArray[np.complexfloating], t_s: Array, p_m: Array, limits: ChainLimits, *, grid: Grid | None = None
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    """As `chain` where each packet may be off by any of four quarter turns: how many (M,) to turn it by. What leaves a
    sign unknown leaves a quarter turn unknown at half of it."""
    halved = ChainLimits(limits.far_m / 2, limits.near_m / 2, math.cos(math.acos(limits.min_cosine) / 2), limits.gate)
    return _chained(channel, t_s, p_m, halved, grid=grid, roots=4)


def _chained(
    channel: NDArray[np.complexfloating], t_s: Array, p_m: Array, limits: ChainLimits, *, grid: Grid | None, roots: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    parts, on, packets = _parts(channel), known(channel.shape[1], grid), len(channel)
    quarters, keep, segment = np.zeros(packets, np.int64), np.ones(packets, np.bool_), np.zeros(packets, np.int64)
    _chain(
        parts,
        *_subcarriers(on),
        np.sqrt(np.square(parts).sum(axis=1)),
        np.ascontiguousarray(t_s, np.float64),
        np.ascontiguousarray(p_m, np.float64),
        np.array([limits.far_m, limits.near_m, limits.min_cosine]),
        limits.gate,
        roots,
        _room(on),
        quarters,
        keep,
        segment,
    )
    return quarters, keep, segment


def _parts(channel: NDArray[np.complexfloating]) -> Array32:
    """(M, 2 S): real and imaginary parts in turn; of a contiguous complex64 array a view."""
    return np.ascontiguousarray(channel, np.complex64).view(np.float32)


@lru_cache(maxsize=8)
def _subcarriers(grid: Grid) -> tuple[Array32, Array32, np.uintp, np.float32]:
    """Frequencies k (W,), with zeros behind them up to whole vector lanes; (W,) 1 where the subcarrier a step on is a
    lag away, else 0; that step, and the lag."""
    k = np.zeros(-(-grid.size // _LANES) * _LANES, np.float32)
    k[: grid.size] = grid.k
    lags = np.zeros(k.size, np.float32)
    lags[grid.first] = 1.0
    return k, lags, np.uintp(grid.step), np.float32(grid.lag)


def _room(grid: Grid) -> Array32:
    """Zeros (10, W + step) to work in: what lies behind the subcarriers adds nothing to any sum. Unsigned indices,
    which cannot wrap around, let the compiler see that lanes are safe."""
    return np.zeros((10, _subcarriers(grid)[0].size + grid.step), np.float32)


@inner
def _lag_slope(room: Array32, lags: Array32, step: np.uintp, lag: np.float32) -> np.float32:
    """Phase per unit of k of `room`'s re + j im, from products of subcarriers a lag apart."""
    a = b = np.float32(0.0)
    for subcarrier in range(lags.size):
        s = np.uintp(subcarrier)
        a += lags[s] * (room[_RE, s + step] * room[_RE, s] + room[_IM, s + step] * room[_IM, s])
        b += lags[s] * (room[_IM, s + step] * room[_RE, s] - room[_RE, s + step] * room[_IM, s])
    return np.float32(math.atan2(b, a) / lag)


@inner
def _phasors(slope: np.float32, start: np.float32, k: Array32, room: Array32) -> None:
    """exp(-j (slope k + start)), (W,), into `room`."""
    for s in range(k.size):
        turns = -(slope * k[s] + start) * _TURN
        room[_COS, s], room[_SIN, s] = phasor(turns - np.rint(turns))


@inner
def _sum(slope: np.float32, k: Array32, room: Array32) -> tuple[np.float32, np.float32]:
    """Sum of (re + j im) exp(-j slope k)."""
    _phasors(slope, _ZERO, k, room)
    a = b = np.float32(0.0)
    for s in range(k.size):
        a += room[_RE, s] * room[_COS, s] - room[_IM, s] * room[_SIN, s]
        b += room[_RE, s] * room[_SIN, s] + room[_IM, s] * room[_COS, s]
    return a, b


@compiled
def _take_delay_out(
    channel: Array32, k: Array32, lags: Array32, step: np.uintp, lag: np.float32, turn: Array32, room: Array32
) -> None:
    size = channel.shape[1] // 2
    for i in range(channel.shape[0]):
        for s in range(size):
            room[_RE, s], room[_IM, s] = channel[i, 2 * s], channel[i, 2 * s + 1]
        _phasors(_lag_slope(room, lags, step, lag), -turn[i], k, room)
        for s in range(size):
            channel[i, 2 * s] = room[_RE, s] * room[_COS, s] - room[_IM, s] * room[_SIN, s]
            channel[i, 2 * s + 1] = room[_RE, s] * room[_SIN, s] + room[_IM, s] * room[_COS, s]


@compiled
def _fold(
    forward: Array32,
    reverse: Array32,
    k: Array32,
    lags: Array32,
    step: np.uintp,
    lag: np.float32,
    channel: Array32,
    centre: Array32,
    told: Array32,
    room: Array32,
) -> None:
    """`told` (2, M): reciprocity and amplitude."""
    size, half = forward.shape[1] // 2, np.float32(0.5)
    for i in range(forward.shape[0]):
        power_f = power_r = np.float32(0.0)
        for s in range(size):
            room[_F_RE, s], room[_F_IM, s] = forward[i, 2 * s], forward[i, 2 * s + 1]
            room[_R_RE, s], room[_R_IM, s] = reverse[i, 2 * s], reverse[i, 2 * s + 1]
            power_f += room[_F_RE, s] * room[_F_RE, s] + room[_F_IM, s] * room[_F_IM, s]
            power_r += room[_R_RE, s] * room[_R_RE, s] + room[_R_IM, s] * room[_R_IM, s]
        root_f, root_r = math.sqrt(power_f / np.float32(size)), math.sqrt(power_r / np.float32(size))
        told[1, i] = math.sqrt(root_f) * math.sqrt(root_r)
        scale_f = _ONE / (root_f if root_f > _LEAST else _LEAST)
        scale_r = _ONE / (root_r if root_r > _LEAST else _LEAST)
        for s in range(k.size):
            room[_F_RE, s], room[_F_IM, s] = scale_f * room[_F_RE, s], scale_f * room[_F_IM, s]
            room[_R_RE, s], room[_R_IM, s] = scale_r * room[_R_RE, s], scale_r * room[_R_IM, s]
            room[_RE, s] = room[_F_RE, s] * room[_R_RE, s] - room[_F_IM, s] * room[_R_IM, s]
            room[_IM, s] = room[_F_RE, s] * room[_R_IM, s] + room[_F_IM, s] * room[_R_RE, s]
        slope = a = b = total = mean = spread = np.float32(0.0)
        # Of their product, then of their ratio.
        for of in range(2):
            if of == 1:
                for s in range(k.size):
                    room[_RE, s] = room[_F_RE, s] * room[_R_RE, s] + room[_F_IM, s] * room[_R_IM, s]
                    room[_IM, s] = room[_F_IM, s] * room[_R_RE, s] - room[_F_RE, s] * room[_R_IM, s]
                    weight = math.sqrt(room[_RE, s] * room[_RE, s] + room[_IM, s] * room[_IM, s])
                    room[_WEIGHT, s] = weight
                    total += weight
                    mean += weight * k[s]
                mean /= total if total > _LEAST else _LEAST
                for s in range(k.size):
                    room[_AWAY, s] = k[s] - mean
                    spread += room[_WEIGHT, s] * room[_AWAY, s] * room[_AWAY, s]
            slope = _lag_slope(room, lags, step, lag)
            for left in range(_STEPS * of, -1, -1):
                a, b = _sum(slope, k, room)
                if left == 0:
                    break
                # Newton's step to the maximum of |sum ratio exp(-j slope k)|, with the curvature of phases that agree.
                x = y = np.float32(0.0)
                for s in range(k.size):
                    x += room[_AWAY, s] * (room[_RE, s] * room[_COS, s] - room[_IM, s] * room[_SIN, s])
                    y += room[_AWAY, s] * (room[_RE, s] * room[_SIN, s] + room[_IM, s] * room[_COS, s])
                curve = spread * math.sqrt(a * a + b * b)
                slope += (y * a - x * b) / (curve if curve > _LEAST else _LEAST)
            if of == 0:
                centre[i, 0], centre[i, 1] = a / np.float32(size), b / np.float32(size)
        told[0, i] = math.sqrt(a * a + b * b) / np.float32(size)
        _phasors(half * slope, half * math.atan2(b, a), k, room)
        for s in range(size):
            re, im = room[_F_RE, s] + room[_R_RE, s], room[_F_IM, s] - room[_R_IM, s]
            channel[i, 2 * s] = half * (re * room[_COS, s] - im * room[_SIN, s])
            re, im = room[_F_RE, s] - room[_R_RE, s], room[_F_IM, s] + room[_R_IM, s]
            channel[i, 2 * s + 1] = half * (re * room[_SIN, s] + im * room[_COS, s])


@compiled
def _chain(
    h: Array32,
    k: Array32,
    lags: Array32,
    step: np.uintp,
    lag: np.float32,
    norm: Array32,
    t_s: Array,
    p_m: Array,
    limits: Array,
    gate: bool,
    roots: int,
    room: Array32,
    quarters: NDArray[np.int64],
    keep: NDArray[np.bool_],
    segment: NDArray[np.int64],
) -> None:
    """`limits` (3,): far and near in metres, and the least cosine. What is told comes last, (M,) each."""
    far_m, near_m, min_cosine = limits[0], limits[1], limits[2]
    rate, last, current, number, skipped = 0.0, 0, 0, 0, 0
    for i in range(1, h.shape[0]):
        for s in range(h.shape[1] // 2):
            room[_RE, s] = h[i, 2 * s] * h[last, 2 * s] + h[i, 2 * s + 1] * h[last, 2 * s + 1]
            room[_IM, s] = h[i, 2 * s + 1] * h[last, 2 * s] - h[i, 2 * s] * h[last, 2 * s + 1]
        a, b = _sum(_lag_slope(room, lags, step, lag), k, room)
        dt = t_s[i] - t_s[last]
        dt = dt if dt > 1e-4 else 1e-4
        size, most = math.hypot(float(a), float(b)), float(norm[i] * norm[last])
        likeness = size / (most if most > 1e-12 else 1e-12)
        size = size if size > 1e-12 else 1e-12
        cosine, sine = math.cos(rate * dt) / size, math.sin(rate * dt) / size
        re, im = a * cosine + b * sine, b * cosine - a * sine
        turned = 0 if re >= 0.0 else 2
        if roots == 4:
            # The root that fits best comes first; what is left is within an eighth of a turn.
            turned = int(np.rint(math.atan2(im, re) / (0.5 * math.pi)))
        cosine, sine = math.cos(0.5 * math.pi * turned), math.sin(0.5 * math.pi * turned)
        re, im = re * cosine + im * sine, im * cosine - re * sine
        if gate and re < min_cosine and skipped < _MAX_SKIPPED and dt < _RATE_TIME_S:
            keep[i] = False
            skipped += 1
            continue
        moved2 = 0.0
        for axis in range(3):
            moved2 += (p_m[i, axis] - p_m[last, axis]) * (p_m[i, axis] - p_m[last, axis])
        is_far = moved2 > far_m * far_m and not (roots == 4 and dt < _FORETOLD_S)
        starts = is_far or (moved2 > near_m * near_m and re * likeness < min_cosine)
        if starts and roots != 4:
            rate = 0.0
        else:
            # Of four roots: without its rate the packet after a break, too, would lie too far off, and so on.
            rate += (1 - math.exp(-dt / _RATE_TIME_S)) * math.atan2(im, re) / dt
        number, current = (number + 1, 0) if starts else (number, (current - turned) % 4)
        quarters[i], segment[i], last, skipped = current, number, i, 0
