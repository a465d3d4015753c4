"""How well a phase holds from packet to packet while nothing moves: what a synthetic aperture needs of a card."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from wsr.ofdm import Grid
from wsr.reciprocity import fold
from wsr.turnaround import carrier_offset_hz, jitter_s


def rest_spread_rad(
    forward: NDArray[np.complex64],
    reverse: NDArray[np.complex64],
    nic_us: NDArray[np.float64],
    wavelength_m: float,
    *,
    grid: Grid,
    half_turns: bool,
) -> float:
    """Circular deviation of the two-way phase of exchanges (M, S) between robots that stand, after all corrections:
    packets' delays, turnaround jitter by both clocks (M, 2), and, with `half_turns`, the chains' random signs.

    Signs are told by squaring: phases are then known but for half a turn, and one that is pure chance spreads by 52
    degrees or more instead of by a turn.
    """
    product = fold(forward, reverse, grid).centre.astype(np.complex128)
    power = 2 if half_turns else 1
    clock_s = (nic_us[:, 0] - nic_us[0, 0]) * 1e-6
    turnaround_s = (nic_us[:, 1] - nic_us[:, 0]) * 1e-6
    # The squared product has carriers at twice the frequency.
    offset_hz = carrier_offset_hz(product**power, turnaround_s, clock_s, wavelength_m / power) / power
    late_s = jitter_s(turnaround_s, clock_s, offset_hz, wavelength_m)
    turned = (product * np.exp(2j * math.pi * offset_hz * late_s)) ** power
    mean = float(np.abs(np.mean(turned / np.maximum(np.abs(turned), 1e-12))))
    return math.sqrt(-2.0 * math.log(max(mean, 1e-9))) / power
