"""Apertures to measure with: 1.2 m of flight or of driving, with what two real cards would have recorded of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from csi_bridge.feitcsi.channel import thinned_hz
from csi_bridge.feitcsi.rate import Format
from csi_bridge.feitcsi.tones import tones
from wsr.aperture import Aperture, make_aperture
from wsr.channel import centre_channel, channel_frequency_hz, wavelength_m
from wsr.geometry import direction
from wsr.ofdm import INDICES_5300_20MHZ, UNIT_HZ, grid

Complex = npt.NDArray[np.complex128]

CHANNEL = 108
WAVELENGTH_M = wavelength_m(CHANNEL)
_C_M_S = 299_792_458.0
_SNR_DB = 20.0
_OFFSET_HZ = 8_000.0
_TURNAROUND_S = 300e-6
_JITTER_S = 5e-6


def helix(
    packets: int, planar: bool = False, range_m: float = 8.0, seed: int = 1, *, ax_mhz: int | None = None
) -> Aperture:
    """M packets over one turn of a helix (or its plan), a source at `range_m`, 30 subcarriers in both directions, or
    those of an AX card's HE packets over `ax_mhz`, thinned, with a random sign at each end.

    Each packet has its own detection delay at both ends, its own turnaround time, and noise.
    """
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, packets)
    height = np.zeros(packets) if planar else 0.12 * np.cos(2 * np.pi * s)
    p_m = np.stack([0.9 * s, 0.12 * np.sin(2 * np.pi * s), height], axis=1)
    source = p_m.mean(axis=0) + range_m * direction(0.9, np.pi / 2 if planar else 1.8)
    offset_hz = np.asarray(INDICES_5300_20MHZ * UNIT_HZ if ax_mhz is None else _ax_hz(ax_mhz), np.float64)
    delay_s = np.linalg.norm(source - p_m, axis=1)[:, None] / _C_M_S
    channel = np.exp(-2j * np.pi * (channel_frequency_hz(CHANNEL) + offset_hz) * delay_s)
    t_s = 3.0 * s
    answer_s = t_s + _TURNAROUND_S + _JITTER_S * rng.normal(size=packets)
    forward = _received(rng, channel * np.exp(2j * np.pi * _OFFSET_HZ * answer_s)[:, None], offset_hz)
    reverse = _received(rng, channel * np.exp(-2j * np.pi * _OFFSET_HZ * t_s)[:, None], offset_hz)
    # Both clocks come from the crystals that make the carriers, so the same offset shows in them.
    skew = _OFFSET_HZ / channel_frequency_hz(CHANNEL)
    nic_us = np.floor(1e6 * np.stack([answer_s * (1 - skew), t_s], axis=1))
    if ax_mhz is not None:
        signs = rng.choice(np.array([-1, 1], np.float32), (2, packets, 1))
        forward, reverse = forward * signs[0], reverse * signs[1]
    on = grid(offset_hz)
    product = centre_channel(forward, on) * centre_channel(reverse, on)
    return make_aperture(
        t_s, p_m, product, WAVELENGTH_M, forward=forward, reverse=reverse, nic_us=nic_us,
        subcarrier_hz=None if ax_mhz is None else offset_hz, half_turns=ax_mhz is not None,
    )  # fmt: skip


def _ax_hz(width_mhz: int) -> npt.NDArray[np.float64]:
    plan = tones(Format.HE, width_mhz)
    assert plan is not None
    return thinned_hz(plan)


def _received(
    rng: np.random.Generator, channel: Complex, offset_hz: npt.NDArray[np.floating[Any]]
) -> npt.NDArray[np.complex64]:
    """With a detection delay for each packet and noise."""
    delay_s = 200e-9 + 25e-9 * rng.normal(size=(len(channel), 1))
    noise = (rng.normal(size=channel.shape) + 1j * rng.normal(size=channel.shape)) * 10 ** (-_SNR_DB / 20) / np.sqrt(2)
    received: Complex = 30 * (channel * np.exp(-2j * np.pi * offset_hz * delay_s) + noise)
    return received.astype(np.complex64)
