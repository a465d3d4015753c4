"""Paths whose lengths and amplitudes can be told by hand: images of images, scatterers, and both ways alike."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from companion.sim.propagation import SUBCARRIER_INDICES, propagate
from companion.sim.scenario import RadioScenario, Reflector, Scatterer

LIGHT_M_S = 299_792_458.0
CENTRE_HZ = 5.54e9
UNITY = LIGHT_M_S / CENTRE_HZ / (4 * math.pi)  # of Friis: the amplitude a metre away
EAST = Reflector((1.0, 0.0, 0.0), 10.0, 0.5, 0.7)
WEST = Reflector((-1.0, 0.0, 0.0), 2.0, 0.4, -1.1)
NORTH = Reflector((0.0, 1.0, 0.0), 5.0, 0.3, 2.0)
TX_M, RX_M = (0.0, 0.0, 1.0), (4.0, 3.0, 1.0)


def _channel(
    radio: RadioScenario, tx_m: tuple[float, ...] = TX_M, rx_m: tuple[float, ...] = RX_M
) -> npt.NDArray[np.complex128]:
    return np.asarray(propagate(np.array([tx_m]), np.array([[rx_m]]), radio)[0, :, 0])


def _paths(*amplitudes_and_lengths: tuple[complex, float]) -> npt.NDArray[np.complex128]:
    """The sum over paths by its definition."""
    f_hz = CENTRE_HZ + 312_500.0 * SUBCARRIER_INDICES
    waves = [a * UNITY * np.exp(-2j * math.pi * f_hz * d_m / LIGHT_M_S) for a, d_m in amplitudes_and_lengths]
    return np.asarray(sum(waves))


def test_the_direct_path_is_that_of_friis() -> None:
    assert _channel(RadioScenario(reflectors=())) == pytest.approx(_paths((1 / 5.0, 5.0)), rel=1e-9)


def test_a_reflector_adds_the_mirror_image() -> None:
    ground = Reflector((0.0, 0.0, 1.0), 0.0, 0.3, 3.1)
    radio = RadioScenario(direct_gain=0.5, reflectors=(ground,))
    tx_m, rx_m = (0.0, 0.0, 1.5), (7.0, 2.0, 0.5)
    direct_m, mirrored_m = math.dist(tx_m, rx_m), math.dist((0.0, 0.0, -1.5), rx_m)
    expected = _paths((0.5 / direct_m, direct_m), (0.3 * np.exp(3.1j) / mirrored_m, mirrored_m))
    assert _channel(radio, tx_m, rx_m) == pytest.approx(expected, rel=1e-9)


def test_walls_that_meet_make_one_image_of_an_image() -> None:
    radio = RadioScenario(direct_gain=0.0, reflectors=(EAST, NORTH), reflection_order=2)
    east_m, north_m = math.hypot(16.0, 3.0), math.hypot(4.0, 7.0)
    corner_m = math.hypot(16.0, 7.0)  # to (20, 10), behind both
    expected = _paths(
        (0.5 * np.exp(0.7j) / east_m, east_m),
        (0.3 * np.exp(2.0j) / north_m, north_m),
        (0.15 * np.exp(2.7j) / corner_m, corner_m),
    )
    assert _channel(radio) == pytest.approx(expected, rel=1e-9)


def test_walls_that_face_each_other_make_two() -> None:
    once = RadioScenario(direct_gain=0.0, reflectors=(EAST, WEST))
    twice = replace(once, reflection_order=2)
    # By the East wall first: the image at 20 goes to -24; by the West wall first: that at -4 goes to 24.
    lengths_m = math.hypot(28.0, 3.0), math.hypot(20.0, 3.0)
    expected = _paths(*((0.2 * np.exp(-0.4j) / d_m, d_m) for d_m in lengths_m))
    assert _channel(twice) - _channel(once) == pytest.approx(expected, rel=1e-6)


def test_a_scatterer_sends_on_what_its_cross_section_takes() -> None:
    cabinet = Scatterer((0.0, 12.0, 1.0), 4 * math.pi * 0.04, 0.3)
    radio = RadioScenario(direct_gain=0.0, reflectors=(), scatterers=(cabinet,))
    out_m, back_m = 12.0, math.hypot(4.0, 9.0)
    exact = 0.2 * np.exp(0.3j) / math.sqrt((out_m**2 + 0.04) * (back_m**2 + 0.04))
    assert _channel(radio) == pytest.approx(_paths((exact, out_m + back_m)), rel=1e-9)
    # The radar equation: P_r / P_t = lambda^2 sigma / ((4 pi)^3 d1^2 d2^2).
    wavelength_m = LIGHT_M_S / CENTRE_HZ
    share = wavelength_m**2 * cabinet.cross_section_m2 / ((4 * math.pi) ** 3 * out_m**2 * back_m**2)
    assert np.abs(_channel(radio)) ** 2 == pytest.approx(share, rel=1e-3)


def test_a_scatterer_beside_the_antenna_sends_out_no_more_than_arrives() -> None:
    steel = Scatterer((0.0, 0.0, 1.0), 10.0)
    radio = RadioScenario(direct_gain=0.0, reflectors=(), scatterers=(steel,))
    assert np.abs(_channel(radio)).max() < UNITY / 5.0


def test_every_path_is_the_same_both_ways() -> None:
    scatterers = (Scatterer((1.0, 2.0, 0.4), 3.0, 0.5), Scatterer((5.0, -1.0, 2.0), 0.5, 1.0))
    radio = RadioScenario(reflectors=(EAST, NORTH, WEST), reflection_order=2, scatterers=scatterers)
    assert _channel(radio, TX_M, RX_M) == pytest.approx(_channel(radio, RX_M, TX_M), rel=1e-9)
