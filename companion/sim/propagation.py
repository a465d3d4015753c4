"""Radio waves between antennas: the direct path and mirror images, as a channel at each of the card's subcarriers.

Constants and physics are written out here on purpose instead of being taken from the estimator's package: the
simulator is what the estimator's signs and scales are checked against.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.sim.scenario import Reflector

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

LIGHT_M_S: Final = 299_792_458.0
SUBCARRIER_INDICES: Final = np.array([*range(-28, -1, 2), -1, *range(1, 28, 2), 28], dtype=np.float64)
"""The 30 reported subcarriers of a 20 MHz channel."""
SUBCARRIER_STEP_HZ: Final = 312_500.0


def carrier_hz(channel: int) -> float:
    """Centre of a channel in the 5 GHz band: 5000 + 5 * channel MHz."""
    return 5e9 + 5e6 * channel


def propagate(
    tx_enu_m: Array,
    rx_enu_m: Array,
    channel: int,
    direct_gain: float,
    reflectors: Sequence[Reflector],
) -> ComplexArray:
    """Channel gain (N, 30, R) from tx_enu_m (N, 3) to rx_enu_m (N, R, 3), both isotropic.

    H(f) = sum over paths of a * lambda / (4 pi d) * exp(-j 2 pi f d / c) (Friis), with one path to the transmitter
    itself and one to its mirror image behind each reflector.
    """
    sources_m = _sources(tx_enu_m, reflectors)
    gains = np.array([direct_gain, *(p.gain * np.exp(1j * p.phase_rad) for p in reflectors)])
    apart_m = sources_m[:, :, None, :] - rx_enu_m
    d_m = np.sqrt(np.einsum("pnrx,pnrx->pnr", apart_m, apart_m))
    centre_hz = carrier_hz(channel)
    amplitude = gains[:, None, None] * (LIGHT_M_S / (4 * math.pi * centre_hz) / d_m)
    f_hz = centre_hz + SUBCARRIER_STEP_HZ * SUBCARRIER_INDICES
    waves = np.exp((-2j * math.pi / LIGHT_M_S) * d_m[:, :, None, :] * f_hz[:, None])
    result: ComplexArray = np.einsum("pnr,pnkr->nkr", amplitude, waves)
    return result


def _sources(tx_enu_m: Array, reflectors: Sequence[Reflector]) -> Array:
    """(1 + P, N, 3): the transmitter and its image behind each of P planes, x - 2 (normal . x - offset) normal."""
    normals = np.array([(0.0, 0.0, 0.0), *(plane.normal for plane in reflectors)])
    offsets_m = np.array([0.0, *(plane.offset_m for plane in reflectors)])
    beyond_m = normals @ tx_enu_m.T - offsets_m[:, None]
    sources_m: Array = tx_enu_m - 2 * beyond_m[..., None] * normals[:, None]
    return sources_m
