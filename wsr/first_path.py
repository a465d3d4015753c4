"""What arrives first: over a wide band the straight path is told from those that are longer, and they are left out.

A band B resolves delays 1 / B apart: 13 ns, or 4 m of path, over 80 MHz and half of that over 160. Over 20 MHz it
would be 17 m, and nothing can be left out. Each bin's own delay is taken out against the bins before it, since the
centroid of power, which does that elsewhere, moves as paths fade. Then

    a_b(tau) = sum_k w(k) h_b(k) exp(+j 2 pi tau f_k),        P(tau) = mean_b |a_b(tau)|^2,

with a window w whose side lobes are 43 dB down. The first peak of P above noise and side lobes is the first path; the
channel that is left is a_b just before it and on it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from wsr.ofdm import UNIT_HZ, Grid

LEAST_BAND_HZ: Final = 60e6
"""Below it rooms are no longer than what the band resolves."""
_MEMORY: Final = 0.8
_STEPS: Final = 2
_EARLIEST_S, _LATEST_S = -150e-9, 150e-9
_PER_RESOLUTION: Final = 8
_BELOW_STRONGEST: Final = 10 ** (-16 / 10)
_ABOVE_NOISE: Final = 6.0
_WEAK_BELOW: Final = 0.5
_TAPS: Final = (-0.4, 0.0)
"""In units of 1 / B, from the first peak. What comes after it weighs less in the earlier one."""

Complex = NDArray[np.complex128]
Array = NDArray[np.float64]


def is_wide(grid: Grid) -> bool:
    return grid.size > 1 and grid.bandwidth_hz >= LEAST_BAND_HZ


def first_arrivals(channel: NDArray[np.complexfloating], grid: Grid) -> Complex:
    """The taps (B, 2) of bins (B, S) in the order of the path that hold the first path, each bin's with the same power
    but for weak ones, which stay weak."""
    h = steady(np.asarray(channel, np.complex128), grid)
    tau_s = first_delay_s(h, grid)
    taps = _taps(h, grid, tau_s + np.array(_TAPS) / grid.bandwidth_hz)
    amplitude = np.sqrt(np.square(np.abs(taps)).mean(axis=1, keepdims=True))
    return np.asarray(taps / np.maximum(amplitude, _WEAK_BELOW * max(float(np.median(amplitude)), 1e-300)))


def steady(channel: Complex, grid: Grid) -> Complex:
    """Bins (B, S) with a delay each that lets their response go on evenly; the phase at the centre stays."""
    result = np.empty_like(channel)
    usual = channel[0].copy()
    for b, h in enumerate(channel):
        ratio = h * usual.conj()
        slope = float(np.angle(ratio[grid.second] @ ratio[grid.first].conj())) / grid.lag
        for _ in range(_STEPS):
            slope += _remaining(ratio * np.exp(-1j * slope * grid.k), grid.k)
        result[b] = h * np.exp(-1j * slope * grid.k)
        agreement = np.vdot(usual, result[b])
        usual = _MEMORY * usual + (1 - _MEMORY) * result[b] * (agreement.conj() / max(abs(agreement), 1e-300))
    return result


def first_delay_s(steady_channel: Complex, grid: Grid) -> float:
    """Delay [s] of the first peak of the mean response of bins (B, S)."""
    step_s = 1 / (_PER_RESOLUTION * grid.bandwidth_hz)
    tau_s = np.arange(_EARLIEST_S, _LATEST_S, step_s)
    power = np.square(np.abs(_taps(steady_channel, grid, tau_s))).mean(axis=0)
    least = max(_BELOW_STRONGEST * float(power.max()), _ABOVE_NOISE * float(np.percentile(power, 10)))
    inner = power[1:-1]
    peaks = np.flatnonzero((inner >= power[:-2]) & (inner > power[2:]) & (inner >= least)) + 1
    return float(tau_s[peaks[0] if len(peaks) else int(np.argmax(power))])


def _taps(channel: Complex, grid: Grid, tau_s: Array) -> Complex:
    """a (B, T) at delays (T,)."""
    span = grid.k[-1] - grid.k[0]
    window = 0.54 + 0.46 * np.cos(2 * np.pi * (grid.k - (grid.k[-1] + grid.k[0]) / 2) / span)
    return np.asarray((channel * window) @ np.exp(2j * np.pi * UNIT_HZ * np.outer(grid.k, tau_s)) / grid.size)


def _remaining(turned: Complex, k: Array) -> float:
    """Least-squares slope per unit of k of phases (S,) about their mean, weighted by power."""
    weight = np.abs(turned)
    total = max(float(weight.sum()), 1e-300)
    centred = k - float(weight @ k) / total
    phase = np.angle(turned * turned.sum().conjugate())
    return float((weight * centred) @ phase) / max(float(weight @ centred**2), 1e-300)
