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

import numpy as np
from numpy.typing import NDArray

from wsr.kernel import phasor
from wsr.machine_code import compiled, inner
from wsr.ofdm import Grid, known

_LANES = 16
_STEPS = 2
_TURN = np.float32(1 / (2 * math.pi))
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
    result = Folded(
        np.empty(forward.shape, np.complex64),
        np.empty(packets, np.float32),
        np.empty(packets, np.complex64),
        np.empty(packets, np.float32),
    )
    _fold(
        _parts(forward),
        _parts(reverse),
        _indices(on),
        _lags(on),
        on.step,
        np.float32(on.lag),
        _parts(result.channel),
        result.reciprocity,
        result.centre,
        result.amplitude,
    )
    return result


def without_delay(
    channel: NDArray[np.complexfloating], turn_rad: Array | None = None, grid: Grid | None = None
) -> Complex64:
    """The same (M, S) with the delay of each packet's power centroid taken out and each packet turned by `turn_rad`
    (M,)."""
    on = known(channel.shape[1], grid)
    result = np.array(channel, np.complex64, order="C")
    turns = np.zeros(len(channel)) if turn_rad is None else turn_rad
    _take_delay_out(
        _parts(result), _indices(on), _lags(on), on.step, np.float32(on.lag), turns.astype(np.float32, order="C")
    )
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
    parts, on = _parts(channel), known(channel.shape[1], grid)
    return _chain(
        parts,
        _indices(on),
        _lags(on),
        on.step,
        np.float32(on.lag),
        np.sqrt(np.square(parts).sum(axis=1)),
        np.ascontiguousarray(t_s, np.float64),
        np.ascontiguousarray(p_m, np.float64),
        limits.far_m,
        limits.near_m,
        limits.min_cosine,
        limits.gate,
        roots,
    )


def _parts(channel: NDArray[np.complexfloating]) -> Array32:
    """(M, 2 S): real and imaginary parts in turn; of a contiguous complex64 array a view."""
    return np.ascontiguousarray(channel, np.complex64).view(np.float32)


def _indices(grid: Grid) -> Array32:
    """Frequencies k (W,), with zeros behind them up to whole vector lanes."""
    k = np.zeros(-(-grid.size // _LANES) * _LANES, np.float32)
    k[: grid.size] = grid.k
    return k


def _lags(grid: Grid) -> Array32:
    """(W,) 1 where the subcarrier `step` positions on is a lag away, else 0."""
    lags = np.zeros(_indices(grid).size, np.float32)
    lags[grid.first] = 1.0
    return lags


@inner
def _scratch(k: Array32, step: int) -> Array32:
    """Zeros (W + step,): what lies behind the subcarriers adds nothing to any sum."""
    return np.zeros(k.size + step, np.float32)


@inner
def _lag_slope(re: Array32, im: Array32, lags: Array32, step: int, lag: np.float32) -> np.float32:
    """Phase per unit of k of re + j im (S,), from products of subcarriers a lag apart."""
    a = b = np.float32(0.0)
    if step == 1:  # a loop of its own, whose vectors lie where the compiler knows them
        for s in range(lags.size):
            a += lags[s] * (re[s + 1] * re[s] + im[s + 1] * im[s])
            b += lags[s] * (im[s + 1] * re[s] - re[s + 1] * im[s])
    else:
        for s in range(lags.size):
            a += lags[s] * (re[s + step] * re[s] + im[s + step] * im[s])
            b += lags[s] * (im[s + step] * re[s] - re[s + step] * im[s])
    return np.float32(np.arctan2(b, a) / lag)


@inner
def _phasors(slope: np.float32, start: np.float32, k: Array32, cosine: Array32, sine: Array32) -> None:
    """exp(-j (slope k + start)), (S,)."""
    for s in range(k.size):
        turns = -(slope * k[s] + start) * _TURN
        r = turns - np.rint(turns)
        cosine[s], sine[s] = phasor(r)


@inner
def _sum(
    re: Array32, im: Array32, slope: np.float32, k: Array32, cosine: Array32, sine: Array32
) -> tuple[np.float32, np.float32]:
    """Sum of (re + j im) exp(-j slope k)."""
    _phasors(slope, np.float32(0.0), k, cosine, sine)
    a = b = np.float32(0.0)
    for s in range(k.size):
        a += re[s] * cosine[s] - im[s] * sine[s]
        b += re[s] * sine[s] + im[s] * cosine[s]
    return a, b


@compiled
def _take_delay_out(channel: Array32, k: Array32, lags: Array32, step: int, lag: np.float32, turn: Array32) -> None:
    size = channel.shape[1] // 2
    re, im, cosine, sine = _scratch(k, step), _scratch(k, step), _scratch(k, step), _scratch(k, step)
    for i in range(channel.shape[0]):
        for s in range(size):
            re[s], im[s] = channel[i, 2 * s], channel[i, 2 * s + 1]
        _phasors(_lag_slope(re, im, lags, step, lag), -turn[i], k, cosine, sine)
        for s in range(size):
            channel[i, 2 * s] = re[s] * cosine[s] - im[s] * sine[s]
            channel[i, 2 * s + 1] = re[s] * sine[s] + im[s] * cosine[s]


@compiled
def _fold(
    forward: Array32,
    reverse: Array32,
    k: Array32,
    lags: Array32,
    step: int,
    lag: np.float32,
    channel: Array32,
    reciprocity: Array32,
    centre: Complex64,
    amplitude: Array32,
) -> None:
    size, half = forward.shape[1] // 2, np.float32(0.5)
    f_re, f_im, r_re, r_im = _scratch(k, step), _scratch(k, step), _scratch(k, step), _scratch(k, step)
    re, im, cosine, sine, away = (
        _scratch(k, step),
        _scratch(k, step),
        _scratch(k, step),
        _scratch(k, step),
        _scratch(k, step),
    )
    for i in range(forward.shape[0]):
        power_f = power_r = np.float32(0.0)
        for s in range(size):
            f_re[s], f_im[s] = forward[i, 2 * s], forward[i, 2 * s + 1]
            r_re[s], r_im[s] = reverse[i, 2 * s], reverse[i, 2 * s + 1]
            power_f += f_re[s] * f_re[s] + f_im[s] * f_im[s]
            power_r += r_re[s] * r_re[s] + r_im[s] * r_im[s]
        root_f, root_r = np.sqrt(power_f / np.float32(size)), np.sqrt(power_r / np.float32(size))
        amplitude[i] = np.sqrt(root_f) * np.sqrt(root_r)
        scale_f, scale_r = np.float32(1.0) / max(root_f, _LEAST), np.float32(1.0) / max(root_r, _LEAST)
        for s in range(k.size):
            f_re[s], f_im[s] = scale_f * f_re[s], scale_f * f_im[s]
            r_re[s], r_im[s] = scale_r * r_re[s], scale_r * r_im[s]
            re[s] = f_re[s] * r_re[s] - f_im[s] * r_im[s]
            im[s] = f_re[s] * r_im[s] + f_im[s] * r_re[s]
        a, b = _sum(re, im, _lag_slope(re, im, lags, step, lag), k, cosine, sine)
        centre[i] = complex(a / np.float32(size), b / np.float32(size))

        total = mean = np.float32(0.0)
        for s in range(k.size):
            re[s] = f_re[s] * r_re[s] + f_im[s] * r_im[s]
            im[s] = f_im[s] * r_re[s] - f_re[s] * r_im[s]
            weight = np.sqrt(re[s] * re[s] + im[s] * im[s])
            total += weight
            mean += weight * k[s]
        mean /= max(total, _LEAST)
        spread = np.float32(0.0)
        for s in range(k.size):
            away[s] = k[s] - mean
            spread += np.sqrt(re[s] * re[s] + im[s] * im[s]) * away[s] * away[s]
        slope = _lag_slope(re, im, lags, step, lag)
        a, b = _sum(re, im, slope, k, cosine, sine)
        for _ in range(_STEPS):
            # Newton's step to the maximum of |sum ratio exp(-j slope k)|, with the curvature of phases that agree.
            x = y = np.float32(0.0)
            for s in range(k.size):
                x += away[s] * (re[s] * cosine[s] - im[s] * sine[s])
                y += away[s] * (re[s] * sine[s] + im[s] * cosine[s])
            slope += (y * a - x * b) / max(spread * np.sqrt(a * a + b * b), _LEAST)
            a, b = _sum(re, im, slope, k, cosine, sine)
        reciprocity[i] = np.sqrt(a * a + b * b) / np.float32(size)
        _phasors(half * slope, half * np.arctan2(b, a), k, cosine, sine)
        for s in range(size):
            channel[i, 2 * s] = half * ((f_re[s] + r_re[s]) * cosine[s] - (f_im[s] - r_im[s]) * sine[s])
            channel[i, 2 * s + 1] = half * ((f_re[s] - r_re[s]) * sine[s] + (f_im[s] + r_im[s]) * cosine[s])


@compiled
def _chain(
    h: Array32,
    k: Array32,
    lags: Array32,
    step: int,
    lag: np.float32,
    norm: Array32,
    t_s: Array,
    p_m: Array,
    far_m: float,
    near_m: float,
    min_cosine: float,
    gate: bool,
    roots: int,
) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.int64]]:
    packets, size = h.shape[0], h.shape[1] // 2
    quarters = np.zeros(packets, np.int64)
    keep = np.ones(packets, np.bool_)
    segment = np.zeros(packets, np.int64)
    re, im, cosine, sine = _scratch(k, step), _scratch(k, step), _scratch(k, step), _scratch(k, step)
    rate, last, current, number, skipped = 0.0, 0, 0, 0, 0
    for i in range(1, packets):
        for s in range(size):
            re[s] = h[i, 2 * s] * h[last, 2 * s] + h[i, 2 * s + 1] * h[last, 2 * s + 1]
            im[s] = h[i, 2 * s + 1] * h[last, 2 * s] - h[i, 2 * s] * h[last, 2 * s + 1]
        a, b = _sum(re, im, _lag_slope(re, im, lags, step, lag), k, cosine, sine)
        q = complex(a, b)
        likeness = abs(q) / max(norm[i] * norm[last], 1e-12)
        q /= max(abs(q), 1e-12)
        dt = max(t_s[i] - t_s[last], 1e-4)
        q *= np.exp(-1j * rate * dt)
        if roots == 4:
            # The root that fits best comes first; what is left is within an eighth of a turn.
            turned = int(np.rint(np.arctan2(q.imag, q.real) / (0.5 * math.pi)))
            q *= np.exp(-0.5j * math.pi * turned)
        else:
            turned = 0 if q.real >= 0 else 2
            q = q if q.real >= 0 else -q
        if gate and q.real < min_cosine and skipped < _MAX_SKIPPED and dt < _RATE_TIME_S:
            keep[i] = False
            skipped += 1
            continue
        moved2 = 0.0
        for axis in range(3):
            moved2 += (p_m[i, axis] - p_m[last, axis]) ** 2
        is_far = moved2 > far_m**2 and not (roots == 4 and dt < _FORETOLD_S)
        if is_far or (moved2 > near_m**2 and q.real * likeness < min_cosine):
            number += 1
            current = 0
            if roots == 4:
                # Without its rate the next packet, too, would lie too far off, and so on.
                rate += (1 - np.exp(-dt / _RATE_TIME_S)) * np.arctan2(q.imag, q.real) / dt
            else:
                rate = 0.0
        else:
            current = (current - turned) % 4
            rate += (1 - np.exp(-dt / _RATE_TIME_S)) * np.arctan2(q.imag, q.real) / dt
        quarters[i], segment[i], last, skipped = current, number, i, 0
    return quarters, keep, segment
