"""The spread of a two-way phase at rest: noise as it is, signs and jitter taken out, chance told from coherence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsr.coherence import rest_spread_rad
from wsr.ofdm import grid

ON = grid(np.arange(-30, 31) * 625e3)
PACKETS = 300
WAVELENGTH_M = 0.0541


def spread_deg(noise_rad: float, half_turns: bool, offset_hz: float = 9_000.0) -> float:
    rng = np.random.default_rng(4)
    room = np.exp(-2j * np.pi * ON.hz * 60e-9) + 0.4 * np.exp(-2j * np.pi * ON.hz * 130e-9)
    ping_us = np.cumsum(rng.uniform(6000, 7500, PACKETS))
    turnaround_us = rng.normal(1000, 100, PACKETS)
    phase = 2 * np.pi * offset_hz * 1e-6 * np.array([ping_us, -(ping_us + turnaround_us)])
    phase[0] += noise_rad * rng.normal(size=PACKETS)
    ends = room * np.exp(1j * phase)[..., None]
    if half_turns:
        ends = ends * rng.choice([-1.0, 1.0], (2, PACKETS, 1))
    # Clock and carrier run off one crystal: the other end's is lower by the offset.
    nic_us = np.stack([ping_us + turnaround_us, ping_us * (1 - offset_hz * WAVELENGTH_M / 299_792_458.0)], axis=1)
    forward, reverse = ends[1].astype(np.complex64), ends[0].astype(np.complex64)
    return math.degrees(rest_spread_rad(forward, reverse, nic_us, WAVELENGTH_M, grid=ON, half_turns=half_turns))


@pytest.mark.parametrize("half_turns", [False, True])
def test_the_spread_is_the_noise_that_is_left(half_turns: bool) -> None:
    assert spread_deg(0.0, half_turns) < 2.0
    assert spread_deg(math.radians(12.0), half_turns) == pytest.approx(12.0, abs=2.0)


def test_a_phase_that_is_chance_is_told() -> None:
    assert spread_deg(3.0, False) > 90.0
    assert spread_deg(3.0, True) > 45.0
