"""Turnaround jitter: what the time between a frame and its answer does to their product, and how to take it out.

The two ends' carriers differ by df. The offsets of forward and reverse channel cancel in the product only if both are
measured at once; the answer comes a turnaround later, so that the product keeps

    g_k ~ exp(+j 4 pi u . chi_k / lambda) exp(-j 2 pi df dt_k).

Both cards stamp what they hear in microseconds, and their clocks run off the same crystals as their carriers: the
difference of the stamps is dt_k plus a ramp of slope df / f. df comes from the products themselves: it is where
neighbouring ones agree best; then ramp and mean are taken out, and what is left is the jitter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wsr.channel import SPEED_OF_LIGHT_M_S
from wsr.kernel import compiled, phasors

MAX_OFFSET_HZ = 100e3
"""Twice 10 parts per million of 5 GHz, what the standard allows each end, is 116 kHz; the recordings have up to 45."""

# Steps of the search: at half of one, phases of the given rms have turned by so much. Then finer, down to the last.
_PHASE_STEP_RAD = 0.3
_LEAST_STEP_HZ, _MOST_STEP_HZ, _LAST_STEP_HZ = 500.0, 4e3, 20.0
_FINER = 8
# Neighbouring products are summed over so many packets, 0.1 s: motion turns them little over that time, and power is
# added over blocks, so that what motion does over longer times does not matter.
_BLOCK = 16
_PRIOR, _PRIOR_SCALE_HZ = 1e-3, 20e3
_LEAST_GAIN = 1e-3
_SKEW_STEPS = 6
_LEAST_SPREAD_S = 5e-7

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def carrier_offset_hz(
    product: NDArray[np.complexfloating], turnaround_s: Array, our_clock_s: Array, wavelength_m: float
) -> float:
    """df (carrier of the other end less ours) at which neighbouring products agree best; 0 where none helps.

    With D_k = z_{k+1} z_k^* of the unit products z, the maximum over df of the mean over blocks of |mean_k D_k exp(j 2
    pi df (dt_{k+1} - dt_k))|, less a little for distance from the df that the skew of the clocks suggests, which
    decides where the turnaround hardly varies. `product` (M,); `turnaround_s` (M,) the other end's stamps less ours,
    with any offset and drift; `our_clock_s` (M,).
    """
    unit = product / np.maximum(np.abs(product), 1e-12)
    step = unit[1:] * unit[:-1].conj()
    size = step.size // _BLOCK * _BLOCK
    if size == 0:
        return 0.0
    skew_hz = _skew(turnaround_s, our_clock_s) * SPEED_OF_LIGHT_M_S / wavelength_m
    expected_hz = min(max(skew_hz, -MAX_OFFSET_HZ), MAX_OFFSET_HZ)
    re, im = (np.ascontiguousarray(part[:size], np.float32) for part in (step.real, step.imag))
    change_s = np.ascontiguousarray(np.diff(turnaround_s)[:size])

    def best(candidates_hz: Array) -> tuple[float, float]:
        agreement = _agreement(candidates_hz, re, im, change_s)
        at = int(np.argmax(agreement - _PRIOR * ((candidates_hz - expected_hz) / _PRIOR_SCALE_HZ) ** 2))
        return float(candidates_hz[at]), float(agreement[at])

    rms_s = max(float(np.sqrt(np.mean(change_s**2))), 1e-9)
    step_hz = min(max(_PHASE_STEP_RAD / (np.pi * rms_s), _LEAST_STEP_HZ), _MOST_STEP_HZ)
    offset_hz, agreement = best(np.arange(-MAX_OFFSET_HZ, MAX_OFFSET_HZ + 1, step_hz))
    while step_hz > _LAST_STEP_HZ:
        around = step_hz * np.linspace(-1.0, 1.0, 2 * _FINER + 1)
        offset_hz, agreement = best(offset_hz + around)
        step_hz /= _FINER
    without = float(_agreement(np.zeros(1), re, im, change_s)[0])
    return offset_hz if agreement > without + _LEAST_GAIN else 0.0


def jitter_s(turnaround_s: Array, our_clock_s: Array, offset_hz: float, wavelength_m: float) -> Array:
    """Turnaround (M,) about its median, with the ramp of the two clocks, df / f per second, taken out."""
    ramp = offset_hz * wavelength_m / SPEED_OF_LIGHT_M_S * (our_clock_s - our_clock_s[0])
    left = turnaround_s - ramp
    return np.asarray(left - np.median(left))


@compiled
def _skew(turnaround_s: Array, clock_s: Array) -> float:
    """Slope of the turnaround over the clock, by least squares with weights that forget outliers."""
    x, y = clock_s - clock_s.mean(), turnaround_s - np.median(turnaround_s)
    weight, slope = np.ones_like(x), 0.0
    for _ in range(_SKEW_STEPS):
        total = weight.sum()
        x0, y0 = (weight * x).sum() / total, (weight * y).sum() / total
        slope = (weight * (x - x0) * (y - y0)).sum() / max((weight * (x - x0) ** 2).sum(), 1e-12)
        left = y - y0 - slope * (x - x0)
        spread = 1.4826 * np.median(np.abs(left)) + _LEAST_SPREAD_S
        weight = 1 / (1 + (left / (2 * spread)) ** 2)
    return float(slope)


@compiled
def _agreement(
    offsets_hz: Array, re: NDArray[np.float32], im: NDArray[np.float32], change_s: Array
) -> NDArray[np.float32]:
    """Mean over blocks of |mean of (re + j im) exp(j 2 pi f change)| for each f."""
    result = np.zeros(offsets_hz.size, np.float32)
    turns = np.empty(change_s.size, np.float64)
    cosine = np.empty(change_s.size, np.float32)
    sine = np.empty(change_s.size, np.float32)
    for i in range(offsets_hz.size):
        for k in range(change_s.size):
            turns[k] = offsets_hz[i] * change_s[k]
        phasors(turns, cosine, sine)
        for start in range(0, change_s.size, _BLOCK):
            a = b = np.float32(0.0)
            for k in range(start, start + _BLOCK):
                a += re[k] * cosine[k] - im[k] * sine[k]
                b += re[k] * sine[k] + im[k] * cosine[k]
            result[i] += np.sqrt(a * a + b * b)
    return result / np.float32(change_s.size)
