"""The one-way channel from both directions of an exchange.

Through one reciprocal channel h both ends measure h times an unknown phase and delay of their own,

    H_f = h exp(+j (a + b k) / 2),    H_r = h exp(-j (a + b k) / 2)

over the subcarrier index k, once the common delay is left aside. a and b come from H_f H_r^*, so h is known but for its
sign: h^2 = H_f H_r. With half the phase of the product a direction has half as many side lobes, noise of the two ends
is averaged instead of multiplied, and several paths add up as fields do. The signs are chained from packet to packet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wsr.channel import SUBCARRIERS_20MHZ
from wsr.kernel import compiled

SUBCARRIERS = SUBCARRIERS_20MHZ.size
TWO_APART = np.flatnonzero(np.diff(SUBCARRIERS_20MHZ) == 2)
"""Positions whose next subcarrier is two steps on: 28 of 29."""

_STEPS = 3
# A residual frequency of the one-way phase, from motion and what is left of the carrier offset, is followed with this
# time constant: a few packets, and much less than a robot needs to turn.
_RATE_TIME_S = 0.03
_MAX_SKIPPED = 3

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


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


def fold(forward: NDArray[np.complex64], reverse: NDArray[np.complex64]) -> tuple[Complex, Array, Complex]:
    """h (M, S), of unit mean power and unknown sign; the reciprocity (M,), 1 where both ends saw the same; and the
    product at the channel centre (M,), without its delay. From both directions (M, S)."""
    k = _indices(forward.shape[1])
    channel = np.empty(forward.shape, np.complex128)
    agreement = np.empty(len(forward))
    centre = np.empty(len(forward), np.complex128)
    _fold(np.ascontiguousarray(forward), np.ascontiguousarray(reverse), k, channel, agreement, centre)
    return channel, agreement, centre


def without_delay(channel: Complex) -> Complex:
    """The same (M, S) with the delay of each packet's power centroid taken out; as it is where S is not 30."""
    result = np.array(channel, np.complex128, order="C")
    if channel.shape[1] == SUBCARRIERS:
        _take_delay_out(result, _indices(SUBCARRIERS))
    return result


def chain(
    channel: Complex, t_s: Array, p_m: Array, limits: ChainLimits
) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Signs (M,) of +-1 that make h continuous, which packets to keep, and the segment each belongs to.

    Between packets, the phase of h h_last^* over all subcarriers, less delay and less the phase that its smoothed rate
    predicts, says whether the sign flipped.
    """
    return _chain(
        channel,
        _indices(channel.shape[1]),
        np.sqrt((np.abs(channel) ** 2).sum(axis=1)),
        np.ascontiguousarray(t_s, np.float64),
        np.ascontiguousarray(p_m, np.float64),
        limits.far_m,
        limits.near_m,
        limits.min_cosine,
        limits.gate,
    )


def _indices(subcarriers: int) -> NDArray[np.int64]:
    """Subcarrier indices; zeros, so that no slope is seen, where they are not the 30 of a 20 MHz channel."""
    return SUBCARRIERS_20MHZ if subcarriers == SUBCARRIERS else np.zeros(subcarriers, np.int64)


@compiled
def _lag_slope(values: Complex, k: NDArray[np.int64]) -> float:
    """Phase per subcarrier index of values (S,), from products of subcarriers two apart."""
    lagged = 0j
    for s in range(k.size - 1):
        if k[s + 1] - k[s] == 2:
            lagged += values[s + 1] * np.conj(values[s])
    return float(np.arctan2(lagged.imag, lagged.real)) / 2


@compiled
def _turn(values: Complex, slope: float, k: NDArray[np.int64], out: Complex) -> complex:
    """out = values exp(-j slope k), (S,); returns its sum."""
    one = np.exp(-1j * slope)
    two = one * one
    phasor = np.exp(-1j * slope * k[0])
    total = 0j
    for s in range(k.size):
        if s > 0:
            step = k[s] - k[s - 1]
            phasor *= two if step == 2 else (one if step == 1 else 1.0)
        out[s] = values[s] * phasor
        total += out[s]
    return total


@compiled
def _take_delay_out(channel: Complex, k: NDArray[np.int64]) -> None:
    for i in range(channel.shape[0]):
        _turn(channel[i], _lag_slope(channel[i], k), k, channel[i])


@compiled
def _fold(
    forward: NDArray[np.complex64],
    reverse: NDArray[np.complex64],
    k: NDArray[np.int64],
    channel: Complex,
    agreement: Array,
    centre: Complex,
) -> None:
    size = k.size
    ahead, back = np.empty(size, np.complex128), np.empty(size, np.complex128)
    ratio, turned = np.empty(size, np.complex128), np.empty(size, np.complex128)
    weight = np.empty(size)
    for i in range(forward.shape[0]):
        power_f = power_r = 1e-12
        for s in range(size):
            ahead[s], back[s] = forward[i, s], reverse[i, s]
            power_f += (ahead[s].real ** 2 + ahead[s].imag ** 2) / size
            power_r += (back[s].real ** 2 + back[s].imag ** 2) / size
            turned[s] = ahead[s] * back[s]
        centre[i] = _turn(turned, _lag_slope(turned, k), k, turned) / size
        scale_f, scale_r = 1 / np.sqrt(power_f), 1 / np.sqrt(power_r)
        total = mean = 0.0
        for s in range(size):
            ahead[s] *= scale_f
            back[s] *= scale_r
            ratio[s] = ahead[s] * np.conj(back[s])
            weight[s] = np.sqrt(ratio[s].real ** 2 + ratio[s].imag ** 2)  # faster than abs
            total += weight[s]
            mean += weight[s] * k[s]
        mean /= max(total, 1e-12)
        spread = 0.0
        for s in range(size):
            spread += weight[s] * (k[s] - mean) ** 2
        slope = _lag_slope(ratio, k)
        level = _turn(ratio, slope, k, turned)
        for _ in range(_STEPS):
            # Newton's step to the maximum of |sum ratio exp(-j slope k)|, with the curvature of phases that agree.
            step = 0.0
            for s in range(size):
                step += (k[s] - mean) * (turned[s].imag * level.real - turned[s].real * level.imag)
            slope += step / max(spread * abs(level), 1e-12)
            level = _turn(ratio, slope, k, turned)
        half = np.exp(-0.5j * np.arctan2(level.imag, level.real))
        _turn(ahead, 0.5 * slope, k, ahead)
        _turn(back, -0.5 * slope, k, back)
        same = 0j
        for s in range(size):
            f, r = ahead[s] * half, back[s] * np.conj(half)
            channel[i, s] = 0.5 * (f + r)
            same += f * np.conj(r)
        agreement[i] = abs(same) / size


@compiled
def _chain(
    h: Complex,
    k: NDArray[np.int64],
    norm: Array,
    t_s: Array,
    p_m: Array,
    far_m: float,
    near_m: float,
    min_cosine: float,
    gate: bool,
) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
    packets, subcarriers = h.shape
    sign = np.ones(packets)
    keep = np.ones(packets, np.bool_)
    segment = np.zeros(packets, np.int64)
    step = np.empty(subcarriers, np.complex128)
    rate, last, current, number, skipped = 0.0, 0, 1.0, 0, 0
    for i in range(1, packets):
        for s in range(subcarriers):
            step[s] = h[i, s] * np.conj(h[last, s])
        q = _turn(step, _lag_slope(step, k), k, step)
        likeness = abs(q) / max(norm[i] * norm[last], 1e-12)
        q /= max(abs(q), 1e-12)
        dt = max(t_s[i] - t_s[last], 1e-4)
        q *= np.exp(-1j * rate * dt)
        cosine = q.real
        if gate and abs(cosine) < min_cosine and skipped < _MAX_SKIPPED and dt < _RATE_TIME_S:
            keep[i] = False
            skipped += 1
            continue
        moved2 = 0.0
        for axis in range(3):
            moved2 += (p_m[i, axis] - p_m[last, axis]) ** 2
        if moved2 > far_m**2 or (moved2 > near_m**2 and abs(cosine) * likeness < min_cosine):
            number += 1
            current, rate = 1.0, 0.0
        else:
            if cosine < 0:
                current, q = -current, -q
            rate += (1 - np.exp(-dt / _RATE_TIME_S)) * np.arctan2(q.imag, q.real) / dt
        sign[i], segment[i], last, skipped = current, number, i, 0
    return sign, keep, segment
