"""The channel of a packet in few numbers, for a link that carries few.

Over 20 MHz an indoor channel has a delay spread of a few hundred nanoseconds at most, so that its 30 subcarriers hold
about bandwidth x spread + 2 = 8 independent values; the rest is noise. With the delay of each packet's detection taken
out, H(k) exp(-j s k), it is projected on the functions that hold most energy of any channel between two delays, the
eigenvectors of G(k, l) = integral exp(-j 2 pi (k - l) df tau) dtau (Slepian's, on the card's uneven subcarriers). The
phase at the channel centre k = 0 stays; the delay itself is the packet's own and says nothing of the path.

Each coefficient is two whole numbers of 6 bits times a scale of the packet, 2^(s / 16 - 9), which loses 2 % of range
at most: an error 28 dB below the channel or better, against 20-30 dB of noise in what the card reports. Every packet
stands by itself, so that it does not matter which ones share a datagram.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wsr.ofdm import GRID_5300, UNIT_HZ, Grid, known

COEFFICIENTS: Final = 8
"""Of a 5300's channel."""
EARLIEST_S: Final = -100e-9
LATEST_S: Final = 200e-9
"""Delays kept, against the packet's own centroid: reflections come after it, the straight path before."""
_SCALES_PER_OCTAVE: Final = 16
_SMALLEST_LOG2: Final = -9
FULL: Final = 31

Coefficients = NDArray[np.int8]


def coefficients(grid: Grid) -> int:
    """How many a channel on `grid` has: bandwidth x spread + 2, 8 over 20 MHz and 26 over 80."""
    return min(grid.size, math.ceil(grid.bandwidth_hz * (LATEST_S - EARLIEST_S)) + 2)


def reduce_channel(csi: NDArray[np.complex64], grid: Grid | None = None) -> tuple[Coefficients, NDArray[np.uint8]]:
    """Coefficients (M, C, 2), real and imaginary, and scales (M,) of CSI (M, S) on `grid` in counts of the card; of a
    5300's 30 subcarriers where it is not given."""
    values, on = np.asarray(csi, np.complex128), known(csi.shape[1], grid)
    slope = np.angle((values[:, on.second] * values[:, on.first].conj()).sum(axis=1)) / on.lag
    projected = (values * np.exp(-1j * slope[:, None] * on.k)) @ _basis(on).conj()
    parts = np.stack([projected.real, projected.imag], axis=-1)
    peak = np.abs(parts).max(axis=(1, 2), initial=0.0)
    wanted = _SCALES_PER_OCTAVE * (np.log2(np.maximum(peak / FULL, 1e-30)) - _SMALLEST_LOG2)
    scale = np.clip(np.ceil(wanted), 0, 255).astype(np.uint8)
    steps = np.clip(np.rint(parts / _unit(scale)[:, None, None]), -FULL, FULL)
    return steps.astype(np.int8), scale


def restore_channel(steps: Coefficients, scale: NDArray[np.uint8], grid: Grid | None = None) -> NDArray[np.complex64]:
    """CSI (M, S) in counts of the card, without the packet's own delay."""
    on = GRID_5300 if grid is None else grid
    parts = steps.astype(np.float64)
    values = (parts[..., 0] + 1j * parts[..., 1]) * _unit(scale)[:, None]
    return np.asarray(values @ _basis(on).T, np.complex64)


def as_sent(csi: NDArray[np.complex64], grid: Grid | None = None) -> NDArray[np.complex64]:
    """CSI (M, S) as the other robot would restore it."""
    return restore_channel(*reduce_channel(csi, grid), grid)


def _unit(scale: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.asarray(np.exp2(scale / _SCALES_PER_OCTAVE + _SMALLEST_LOG2))


@lru_cache(maxsize=16)
def _basis(grid: Grid) -> NDArray[np.complex128]:
    """(S, C), orthonormal."""
    apart_hz = (grid.k[:, None] - grid.k) * UNIT_HZ
    middle_s, width_s = (EARLIEST_S + LATEST_S) / 2, LATEST_S - EARLIEST_S
    energy = np.sinc(apart_hz * width_s) * np.exp(-2j * np.pi * apart_hz * middle_s)
    count = coefficients(grid)
    vectors = np.linalg.eigh(energy)[1][:, ::-1][:, :count]
    # Eigenvectors are known but for a phase, which depends on the library: both ends must have the same.
    largest = vectors[np.abs(vectors).argmax(axis=0), np.arange(count)]
    return np.asarray(vectors * (np.abs(largest) / largest))
