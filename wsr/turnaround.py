"""Turnaround jitter: what the time between a frame and its answer does to their product, and how to take it out.

The two ends' carriers differ by df. The offsets of forward and reverse channel cancel in the product only if both are
measured at once; the answer comes a turnaround later, so that the product keeps

    g_k ~ exp(+j 4 pi u . chi_k / lambda) exp(-j 2 pi df dt_k).

Both cards stamp what they hear in microseconds, and their clocks run off the same crystals as their carriers: the
difference of the stamps is dt_k plus a ramp of slope df / f. df comes from the products themselves, where neighbouring
ones agree best, weighed against that slope; then ramp and mean are taken out, and what is left is the jitter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.channel import SPEED_OF_LIGHT_M_S
from wsr.kernel import turned_phasor
from wsr.machine_code import compiled
from wsr.middle import median

MAX_OFFSET_HZ = 100e3
"""Twice 10 parts per million of 5 GHz, what the standard allows each end, is 116 kHz; the recordings have up to 45."""

# Steps of the search: at half of one, phases of the given rms have turned by so much. Then finer, down to the last.
_PHASE_STEP_RAD = 0.3
_LEAST_STEP_HZ, _MOST_STEP_HZ, _LAST_STEP_HZ = 500.0, 4e3, 20.0
_FINER = 8
# Neighbouring products are summed over so many packets, 0.1 s: motion turns them little over that time, and power is
# added over blocks, so that what motion does over longer times does not matter.
_BLOCK = 16
# Mean and deviation of |mean of so many| for phases that have nothing in common.
_BY_CHANCE, _CHANCE_STD = (math.pi / (4 * _BLOCK)) ** 0.5, ((1 - math.pi / 4) / _BLOCK) ** 0.5
# The skew of recorded clocks is mostly within 2 kHz of the carriers', but turnarounds of two kinds move it by 40.
_LEAST_SKEW_STD_HZ, _TAIL = 2e3, 2.0
_SKEW_STEPS = 6
_LEAST_SPREAD_S = 5e-7

Array = NDArray[np.float64]


def carrier_offset_hz(
    product: NDArray[np.complexfloating], turnaround_s: Array, our_clock_s: Array, wavelength_m: float
) -> float:
    """df (carrier of the other end less ours) at which neighbouring products agree, as the skew of the clocks has it
    where they do not tell.

    With D_k = z_{k+1} z_k^* of the unit products z, the agreement is the mean over blocks of |mean_k D_k exp(j 2 pi df
    (dt_{k+1} - dt_k))|, and the maximum over df that of

        ((agreement - that of chance) / its deviation)^2 / 2 - 2 log(1 + ((df - skew's) / the skew's deviation)^2),

    two logarithms of probabilities. Of few packets, or such as motion turns by more than a radian from one to the next,
    the first is noise, whose highest peak would lie anywhere. `product` (M,); `turnaround_s` (M,) the other end's
    stamps less ours, with any offset and drift; `our_clock_s` (M,). 0 of fewer packets than a block.
    """
    unit = product / np.maximum(np.abs(product), 1e-12)
    step = unit[1:] * unit[:-1].conj()
    size = step.size // _BLOCK * _BLOCK
    if size == 0:
        return 0.0
    carrier_hz = SPEED_OF_LIGHT_M_S / wavelength_m
    skew, skew_std = _skew(turnaround_s, our_clock_s)
    expected_hz = min(max(skew * carrier_hz, -MAX_OFFSET_HZ), MAX_OFFSET_HZ)
    scale_hz = max(skew_std * carrier_hz, _LEAST_SKEW_STD_HZ)
    re, im = (part[:size].astype(np.float32).reshape(-1, _BLOCK) for part in (step.real, step.imag))
    change_s = np.diff(turnaround_s)[:size].reshape(-1, _BLOCK)
    turns, wave = np.empty_like(change_s), np.empty((2, *change_s.shape), np.float32)
    chance_std = _CHANCE_STD * (_BLOCK / size) ** 0.5

    def best(candidates_hz: Array) -> float:
        sums = np.zeros(candidates_hz.size, np.float32)
        _agreement(candidates_hz, re, im, change_s, turns, wave, sums)
        gain = np.maximum(sums / np.float32(size) - _BY_CHANCE, 0.0) / chance_std
        off = (candidates_hz - expected_hz) / scale_hz
        return float(candidates_hz[np.argmax(0.5 * gain**2 - _TAIL * np.log1p(off**2))])

    rms_s = max(float(np.sqrt(np.mean(change_s**2))), 1e-9)
    step_hz = min(max(_PHASE_STEP_RAD / (np.pi * rms_s), _LEAST_STEP_HZ), _MOST_STEP_HZ)
    offset_hz = best(np.append(np.arange(-MAX_OFFSET_HZ, MAX_OFFSET_HZ + 1, step_hz), expected_hz))
    while step_hz > _LAST_STEP_HZ:
        offset_hz = best(offset_hz + step_hz * np.linspace(-1.0, 1.0, 2 * _FINER + 1))
        step_hz /= _FINER
    return offset_hz


def jitter_s(turnaround_s: Array, our_clock_s: Array, offset_hz: float, wavelength_m: float) -> Array:
    """Turnaround (M,) about its median, with the ramp of the two clocks, df / f per second, taken out."""
    ramp = offset_hz * wavelength_m / SPEED_OF_LIGHT_M_S * (our_clock_s - our_clock_s[0])
    left = turnaround_s - ramp
    return np.asarray(left - median(left))


def _skew(turnaround_s: Array, clock_s: Array) -> tuple[float, float]:
    """Slope of the turnaround over the clock, by least squares with weights that forget outliers, and its deviation.

    Not compiled: half a millisecond here is less than five seconds of a first start, most of them for a median.
    """
    x, y = clock_s - clock_s.mean(), turnaround_s - median(turnaround_s)
    weight, slope, std = np.ones_like(x), 0.0, 0.0
    for _ in range(_SKEW_STEPS):
        total = weight.sum()
        x0, y0 = (weight * x).sum() / total, (weight * y).sum() / total
        leverage = max((weight * (x - x0) ** 2).sum(), 1e-12)
        slope = (weight * (x - x0) * (y - y0)).sum() / leverage
        left = y - y0 - slope * (x - x0)
        spread = 1.4826 * median(np.abs(left)) + _LEAST_SPREAD_S
        weight = 1 / (1 + (left / (2 * spread)) ** 2)
        std = spread / np.sqrt(leverage)
    return slope, std


@compiled
def _agreement(
    offsets_hz: Array,
    re: NDArray[np.float32],
    im: NDArray[np.float32],
    change_s: Array,
    turns: Array,
    wave: NDArray[np.float32],
    result: NDArray[np.float32],
) -> None:
    """Sums over blocks (N, _BLOCK) of |sum of (re + j im) exp(j 2 pi f change)| for each f, added to the result.

    Room to work in: `turns` (N, _BLOCK) and `wave` (2, N, _BLOCK). Turns are stored before they are reduced, so that
    no multiply-add makes others of them: the maximum is sought on a grid, and steps with the last digit.
    """
    for i in range(offsets_hz.size):
        for block in range(re.shape[0]):
            for k in range(_BLOCK):
                turns[block, k] = offsets_hz[i] * change_s[block, k]
        for block in range(re.shape[0]):
            for k in range(_BLOCK):
                wave[0, block, k], wave[1, block, k] = turned_phasor(turns[block, k])
        for block in range(re.shape[0]):
            a = b = np.float32(0.0)
            for k in range(_BLOCK):
                a += re[block, k] * wave[0, block, k] - im[block, k] * wave[1, block, k]
                b += re[block, k] * wave[1, block, k] + im[block, k] * wave[0, block, k]
            result[i] += math.sqrt(a * a + b * b)
