"""The channel in 13 bytes: what a multipath channel keeps, and what does not matter."""

from __future__ import annotations

import numpy as np

from wsr.ofdm import INDICES_5300_20MHZ, UNIT_HZ
from wsr.reduced import COEFFICIENTS, as_sent, reduce_channel, restore_channel


def channels(packets: int = 50, delay_std_s: float = 0.0, seed: int = 1) -> np.ndarray:
    """Three paths within 120 ns and a detection delay, (M, 30), about 30 counts."""
    rng = np.random.default_rng(seed)
    delays = (
        np.array([0.0, 40e-9, 120e-9]) + rng.normal(0, delay_std_s, (packets, 1))
        if delay_std_s
        else np.tile([0.0, 40e-9, 120e-9], (packets, 1))
    )
    gains = np.array([1.0, 0.5, 0.2]) * np.exp(2j * np.pi * rng.random((packets, 3)))
    phase = np.exp(-2j * np.pi * UNIT_HZ * INDICES_5300_20MHZ * delays[:, :, None])
    return np.asarray(30 * (gains[:, :, None] * phase).sum(axis=1), np.complex64)


def test_a_channel_of_a_room_survives_to_better_than_30_db() -> None:
    sent = channels()
    got = as_sent(sent)
    # The packet's own delay is taken out: the phase ramp that fits best is not an error.
    k = INDICES_5300_20MHZ
    ratios = []
    for a, b in zip(sent, got, strict=True):
        ramps = np.exp(-1j * np.linspace(-0.4, 0.4, 4001)[:, None] * k)
        ratios.append(np.max(np.abs((ramps * a) @ b.conj()) ** 2) / (np.vdot(a, a).real * np.vdot(b, b).real))
    assert 1 - np.median(ratios) < 2e-3
    assert 1 - np.min(ratios) < 1e-2


def test_the_phase_at_the_centre_stays_whatever_the_delay_of_the_packet() -> None:
    flat = np.tile(30 * np.exp(1j * np.linspace(0, 6, 40))[:, None], 30)
    late = flat * np.exp(-2j * np.pi * UNIT_HZ * INDICES_5300_20MHZ * 250e-9)
    got = as_sent(late.astype(np.complex64)).mean(axis=1)
    assert np.abs(np.angle(got * flat[:, 0].conj())).max() < 0.02


def test_a_packet_does_not_depend_on_those_beside_it() -> None:
    sent = channels()
    whole, scale = reduce_channel(sent)
    for number in (0, 17, 49):
        alone, its_scale = reduce_channel(sent[number : number + 1])
        assert np.abs(alone[0].astype(int) - whole[number]).max() <= 1
        assert its_scale[0] == scale[number]


def test_amplitudes_from_silence_to_full_scale() -> None:
    for amplitude in (0.0, 0.1, 1.0, 180.0):
        sent = np.full((1, 30), amplitude, np.complex64)
        coefficients, scale = reduce_channel(sent)
        assert coefficients.shape == (1, COEFFICIENTS, 2)
        assert np.abs(restore_channel(coefficients, scale) - sent).max() <= 0.15 * amplitude + 5e-3
