"""Exchanges with two sources apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, Array, Complex
from wsr.aperture import Aperture, make_aperture
from wsr.channel import SPEED_OF_LIGHT_M_S, centre_channel
from wsr.geometry import direction
from wsr.ofdm import INDICES_5300_20MHZ, UNIT_HZ

_SUBCARRIER_HZ = INDICES_5300_20MHZ * UNIT_HZ
_DELAY_M = 0.030e-6 * SPEED_OF_LIGHT_M_S
# 25 degrees apart on the sphere: in azimuth 25 on the horizon.
APART = (direction(0.5, math.pi / 2), direction(0.5 + math.radians(25), math.pi / 2))


def exchanged(
    p: Array,
    sources: tuple[Array, ...],
    seed: int = 0,
    snr_db: float = 20.0,
    offset_hz: float = 30_000.0,
    others: float = 1.0,
) -> Aperture:
    """Sources at positions (1, 3), those after the first with the amplitude `others` and each a path 30 ns longer, as
    both cards would record them."""
    rng = np.random.default_rng(seed)
    packets = len(p)
    field = np.zeros((packets, INDICES_5300_20MHZ.size), np.complex128)
    carrier_hz = SPEED_OF_LIGHT_M_S / WAVELENGTH_M + _SUBCARRIER_HZ
    for number, source in enumerate(sources):
        longer = np.linalg.norm(p - source, axis=1)[:, None] + number * _DELAY_M
        phase = 2 * np.pi * carrier_hz / SPEED_OF_LIGHT_M_S * longer
        field += (others if number else 1.0) * np.exp(-1j * (phase + rng.uniform(0, 2 * np.pi)))
    t_s = np.linspace(0.0, 3.0, packets)
    answer_s = t_s + 300e-6 + 5e-6 * rng.normal(size=packets)
    forward = _received(rng, field * np.exp(2j * np.pi * offset_hz * answer_s)[:, None], snr_db)
    reverse = _received(rng, field * np.exp(-2j * np.pi * offset_hz * t_s)[:, None], snr_db)
    skew = offset_hz * WAVELENGTH_M / SPEED_OF_LIGHT_M_S
    nic_us = np.floor(1e6 * np.stack([answer_s * (1 - skew), t_s], axis=1))
    product = centre_channel(forward) * centre_channel(reverse)
    return make_aperture(t_s, p, product, WAVELENGTH_M, forward=forward, reverse=reverse, nic_us=nic_us)


def _received(rng: np.random.Generator, field: Complex, snr_db: float) -> NDArray[np.complex64]:
    delay_s = 200e-9 + 25e-9 * rng.normal(size=(len(field), 1))
    noise = (rng.normal(size=field.shape) + 1j * rng.normal(size=field.shape)) * 10 ** (-snr_db / 20) / math.sqrt(2)
    return np.asarray(30 * (field * np.exp(-2j * np.pi * _SUBCARRIER_HZ * delay_s) + noise)).astype(np.complex64)
