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

from typing import Final

import numpy as np
from numpy.typing import NDArray

from wsr.channel import SUBCARRIER_SPACING_HZ, SUBCARRIERS_20MHZ

COEFFICIENTS: Final = 8
EARLIEST_S: Final = -100e-9
LATEST_S: Final = 200e-9
"""Delays kept, against the packet's own centroid: reflections come after it, the straight path before."""
_SCALES_PER_OCTAVE: Final = 16
_SMALLEST_LOG2: Final = -9
FULL: Final = 31

Coefficients = NDArray[np.int8]


def reduce_channel(csi: NDArray[np.complex64]) -> tuple[Coefficients, NDArray[np.uint8]]:
    """Coefficients (M, 8, 2), real and imaginary, and scales (M,) of CSI (M, 30) in counts of the card."""
    values = np.asarray(csi, np.complex128)
    k = SUBCARRIERS_20MHZ.astype(np.float64)
    two_apart = np.flatnonzero(np.diff(SUBCARRIERS_20MHZ) == 2)
    slope = np.angle((values[:, two_apart + 1] * values[:, two_apart].conj()).sum(axis=1)) / 2
    projected = (values * np.exp(-1j * slope[:, None] * k)) @ _BASIS.conj()
    parts = np.stack([projected.real, projected.imag], axis=-1)
    peak = np.abs(parts).max(axis=(1, 2), initial=0.0)
    wanted = _SCALES_PER_OCTAVE * (np.log2(np.maximum(peak / FULL, 1e-30)) - _SMALLEST_LOG2)
    scale = np.clip(np.ceil(wanted), 0, 255).astype(np.uint8)
    steps = np.clip(np.rint(parts / _unit(scale)[:, None, None]), -FULL, FULL)
    return steps.astype(np.int8), scale


def restore_channel(coefficients: Coefficients, scale: NDArray[np.uint8]) -> NDArray[np.complex64]:
    """CSI (M, 30) in counts of the card, without the packet's own delay."""
    steps = coefficients.astype(np.float64)
    values = (steps[..., 0] + 1j * steps[..., 1]) * _unit(scale)[:, None]
    return np.asarray(values @ _BASIS.T, np.complex64)


def as_sent(csi: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """CSI (M, 30) as the other robot would restore it."""
    return restore_channel(*reduce_channel(csi))


def _unit(scale: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.asarray(np.exp2(scale / _SCALES_PER_OCTAVE + _SMALLEST_LOG2))


def _basis() -> NDArray[np.complex128]:
    """(30, 8), orthonormal."""
    apart_hz = (SUBCARRIERS_20MHZ[:, None] - SUBCARRIERS_20MHZ) * SUBCARRIER_SPACING_HZ
    middle_s, width_s = (EARLIEST_S + LATEST_S) / 2, LATEST_S - EARLIEST_S
    energy = np.sinc(apart_hz * width_s) * np.exp(-2j * np.pi * apart_hz * middle_s)
    vectors = np.linalg.eigh(energy)[1][:, ::-1][:, :COEFFICIENTS]
    # Eigenvectors are known but for a phase, which depends on the library: both ends must have the same.
    largest = vectors[np.abs(vectors).argmax(axis=0), np.arange(COEFFICIENTS)]
    return np.asarray(vectors * (np.abs(largest) / largest))


_BASIS: Final = _basis()
