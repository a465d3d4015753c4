"""Chains that flip: on the captures of an AX card, and in simulation over 80 MHz."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from csi_bridge.feitcsi.channel import thinned
from tests.feit_records import CAPTURES, needs_captures, read_log
from tests.unit.wsr.scene import WAVELENGTH_M, Array, exchange, weave
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture, make_aperture
from wsr.channel import centre_channel
from wsr.estimators import ESTIMATORS
from wsr.geometry import angles, direction, great_circle
from wsr.half_turns import without_half_turns
from wsr.ofdm import grid

HZ_80: Array = np.concatenate([np.arange(-62, 0), np.arange(1, 63)]) * 625e3
SOURCE = np.array([[11.0, 3.0, 2.5]])
MEMORY = 0.8
"""Of the relative phase of two chains: a few packets, as long as a robot keeps its place to a small part of a wave."""


def relative_signs(csi: npt.NDArray[np.complexfloating]) -> npt.NDArray[np.int8]:
    """Signs (M, R) by which to multiply the chains of CSI (M, S, R), in the order of time, so that their phases against
    the strongest one go on evenly. That one's own sign is 1 in every packet; a chain without signal keeps 1."""
    # Their relative phase changes only as the antennas move.
    values = np.asarray(csi, np.complex128)
    strongest = int(np.argmax(np.square(np.abs(values)).sum(axis=(0, 1)))) if len(values) else 0
    between = np.einsum("msr,ms->mr", values, values[:, :, strongest].conj())
    unit = between / np.maximum(np.abs(between), np.finfo(np.float64).tiny)
    signs = np.ones(unit.shape, np.int8)
    for chain in range(unit.shape[1]):
        usual = 0j
        for packet, now in enumerate(unit[:, chain].tolist()):
            flipped = (now * usual.conjugate()).real < 0
            signs[packet, chain] = -1 if flipped else 1
            usual = MEMORY * usual + (-now if flipped else now)
    return signs


@needs_captures
@pytest.mark.parametrize("name", sorted(path.stem for path in CAPTURES.glob("*.csi")))
def test_the_relative_phase_of_both_chains_of_a_capture_is_constant_after_it(name: str) -> None:
    csi = np.array([thinned(record)[0][:, :, 0] for record in read_log(CAPTURES / f"{name}.csi").records])
    signs = relative_signs(csi)
    assert set(np.unique(signs)) == {-1, 1}, "a capture in which no chain flips shows nothing"
    between = np.einsum("ms,ms->m", csi[:, :, 0] * signs[:, None, 0], (csi[:, :, 1] * signs[:, None, 1]).conj())
    phase = np.angle(between / (between / np.abs(between)).sum())
    assert np.abs(phase).max() < math.radians(12)
    before = np.einsum("ms,ms->m", csi[:, :, 0], csi[:, :, 1].conj())
    assert np.ptp(np.angle(before)) > math.radians(160)


def test_signs_of_two_chains_come_back_while_the_antennas_move() -> None:
    rng = np.random.default_rng(3)
    turn = np.exp(1j * np.linspace(0.0, 9.0, 400))[:, None]
    wave = np.exp(1j * rng.uniform(-math.pi, math.pi, (400, 1)))
    csi = np.stack([2.0 * wave * np.ones(30), wave * turn * np.ones(30), np.zeros((400, 30))], axis=-1)
    csi[:, :, :2] += 0.1 * rng.normal(size=(400, 30, 2))
    flips = rng.choice([-1, 1], (400, 3))
    signs = relative_signs(csi * flips[:, None, :])
    relative = flips * flips[:, :1]
    assert (signs[:, 0] == 1).all() and (signs[:, 2] == 1).all()
    assert len(np.unique(signs[:, 1] * relative[:, 1])) == 1


def flipped(seed: int, flips: bool, offset_hz: float = 0.0, packets: int = 600) -> Aperture:
    """An aperture over 80 MHz; with `flips` each end's sign is random in every packet."""
    rng = np.random.default_rng(seed)
    t_s, p_m = weave(packets)
    late_s = 1e-3 + rng.uniform(0, 5e-4, packets)
    forward, reverse = exchange(
        p_m, SOURCE, seed=seed, offset_hz=offset_hz, t_s=t_s, turnaround_s=late_s, subcarrier_hz=HZ_80
    )
    if flips:
        forward *= rng.choice([-1, 1], packets)[:, None]
        reverse *= rng.choice([-1, 1], packets)[:, None]
    on = grid(HZ_80)
    channel = centre_channel(forward, on) * centre_channel(reverse, on)
    carrier_hz = 299_792_458.0 / WAVELENGTH_M
    ours_us, theirs_us = t_s * 1e6, (t_s + late_s) * 1e6 * (1 + offset_hz / carrier_hz)
    return make_aperture(
        t_s, p_m, channel, WAVELENGTH_M, forward=forward, reverse=reverse, subcarrier_hz=HZ_80, half_turns=flips,
        nic_us=np.stack([ours_us, theirs_us], axis=1),
    )  # fmt: skip


def error_deg(estimate: AoaEstimate) -> float:
    truth = SOURCE[0] - np.array(estimate.reference_p_m)
    u = direction(*(float(angle) for angle in angles(truth / np.linalg.norm(truth))))
    return math.degrees(float(great_circle(direction(estimate.azimuth_rad, estimate.polar_rad), u)))


@pytest.mark.parametrize("offset_hz", [0.0, 3000.0])
def test_all_four_roots_are_told(offset_hz: float) -> None:
    aperture = flipped(1, True, offset_hz)
    settled = without_half_turns(aperture)
    truth = flipped(1, False, offset_hz)
    sign = np.real(settled.channel * truth.channel.conj())
    assert not settled.half_turns
    assert (np.sign(sign) == np.sign(sign[0])).mean() > 0.99
    assert without_half_turns(truth) is truth


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_estimates_are_as_good_as_without_flips(name: str) -> None:
    estimator = ESTIMATORS[name]()
    offset_hz = 0.0 if name == "bartlett" else 2000.0  # it does not undo the jitter
    steady, flipping = (estimator.estimate(flipped(2, flips, offset_hz))[0] for flips in (False, True))
    assert error_deg(flipping) < max(1.0, 1.5 * error_deg(steady))
    blind = estimator.estimate(replace(flipped(2, True, offset_hz), half_turns=False))[0]
    assert blind.coherence < 0.8 * flipping.coherence
