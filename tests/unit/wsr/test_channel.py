"""Channel centre from CSI, and pairing of forward and reverse packets."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from wsr import channel
from wsr.ofdm import INDICES_5300_20MHZ, UNIT_HZ

K = INDICES_5300_20MHZ


def _csi(phase_rad: float, delay_s: float, gain: float = 20.0) -> NDArray[np.complex128]:
    """CSI (30,) of one path: phase at the channel centre, and a delay that turns the subcarriers against each other."""
    turn = np.exp(-2j * np.pi * K * UNIT_HZ * delay_s)
    return np.asarray(gain * np.exp(1j * phase_rad) * turn)


def test_subcarriers_are_the_thirty_uneven_ones() -> None:
    assert K.shape == (30,)
    assert list(K[:2]) == [-28, -26]
    assert list(K[13:17]) == [-2, -1, 1, 3]
    assert list(K[-2:]) == [27, 28]
    assert 0 not in K


def test_wavelength_of_channel_108() -> None:
    assert channel.channel_frequency_hz(108) == 5.540e9
    assert channel.wavelength_m(108) == pytest.approx(0.054114, abs=1e-6)


def test_channel_number_of_another_band_is_refused() -> None:
    with pytest.raises(ValueError, match="5540"):
        channel.channel_frequency_hz(5540)


@pytest.mark.parametrize(
    ("number", "named"),
    [(1, "2.4 GHz"), (6, "2.4 GHz"), (14, "2.4 GHz"), (0, "no 5 GHz"), (38, "wide"), (155, "wide"), (200, "no 5")],
)
def test_what_is_no_channel_of_20_mhz_is_named(number: int, named: str) -> None:
    with pytest.raises(ValueError, match=f"channel {number} is .*{named}.*expected one of 36"):
        channel.wavelength_m(number)
    assert len(channel.CHANNELS_5GHZ) == 28


@pytest.mark.parametrize("delay_ns", [-700, -200, -50, 0, 30, 400, 700])
def test_centre_phase_does_not_see_the_delay(delay_ns: float) -> None:
    phases = np.linspace(-3, 3, 7)
    csi = np.stack([_csi(phase, delay_ns * 1e-9) for phase in phases])
    centre = channel.centre_channel(csi)
    np.testing.assert_allclose(np.angle(centre * np.exp(-1j * phases)), 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(centre), 20, rtol=1e-9)


def test_centre_with_noise_and_dead_subcarriers() -> None:
    rng = np.random.default_rng(1)
    packets = 400
    delays = rng.uniform(-300e-9, 300e-9, packets)
    csi = np.stack([_csi(1.0, delay) for delay in delays])
    csi += 4 * (rng.normal(size=csi.shape) + 1j * rng.normal(size=csi.shape))
    csi[:, 4:7] = 0
    error = np.angle(channel.centre_channel(csi) * np.exp(-1j))
    # One subcarrier has 0.2 rad of noise; 27 of them averaged leave 0.04.
    assert np.std(error) < 0.06
    assert np.abs(error).max() < 0.25


def test_slope_is_refined_beyond_its_first_guess() -> None:
    """Where one half of the band is weak, products of neighbours alone leave a delay: 0.14 rad in place of 0.05."""
    rng = np.random.default_rng(6)
    csi = np.stack([_csi(0.5, delay) for delay in rng.uniform(-300e-9, 300e-9, 600)])
    csi += 5 * (rng.normal(size=csi.shape) + 1j * rng.normal(size=csi.shape))
    csi[:, 15:] *= 0.3
    error = np.angle(channel.centre_channel(csi) * np.exp(-0.5j))
    assert np.std(error) < 0.08


def test_subcarriers_of_noise_do_not_turn_the_slope() -> None:
    """A third of the band is noise alone, whose phases say nothing: counted in full they would leave 0.18 rad."""
    rng = np.random.default_rng(7)
    csi = np.stack([_csi(0.5, delay) for delay in rng.uniform(-300e-9, 300e-9, 600)])
    csi[:, 20:] *= 0.0
    csi += rng.normal(size=csi.shape) + 1j * rng.normal(size=csi.shape)
    error = np.angle(channel.centre_channel(csi) * np.exp(-0.5j))
    assert np.std(error) < 0.05


def test_middle_subcarrier_would_see_the_delay() -> None:
    """Negative control: what a delay of 200 ns costs where subcarrier 15 is taken for the centre."""
    assert abs(np.angle(_csi(0.0, 200e-9)[15])) > 0.3


def test_empty_packet_gives_zero_and_wrong_width_is_refused() -> None:
    assert channel.centre_channel(np.zeros((2, 30))).tolist() == [0, 0]
    with pytest.raises(ValueError, match="30 subcarriers"):
        channel.centre_channel(np.zeros((2, 56)))


def test_product_of_forward_and_reverse_cancels_the_carrier_offset() -> None:
    """Both ends hear each other with opposite offsets; the product keeps twice the path phase and nothing else."""
    rng = np.random.default_rng(2)
    path = np.linspace(0, 9, 50)
    offset = rng.uniform(-np.pi, np.pi, 50)
    forward = channel.centre_channel(np.stack([_csi(a, 50e-9) for a in -path + offset]))
    reverse = channel.centre_channel(np.stack([_csi(a, -80e-9) for a in -path - offset]))
    np.testing.assert_allclose(np.angle(forward * reverse * np.exp(2j * path)), 0, atol=1e-9)


def test_pair_by_counter_keeps_forward_order_over_the_wrap() -> None:
    top = 2**32
    forward = np.array([top - 2, top - 1, 0, 1, 2], np.uint32)
    reverse = np.array([1, top - 1, 0, 7], np.uint32)
    i, j = channel.pair_by_counter(forward, reverse)
    assert i.tolist() == [1, 2, 3]
    assert j.tolist() == [1, 2, 0]


def test_pair_by_counter_takes_unwrapped_counters_of_one_side() -> None:
    i, j = channel.pair_by_counter(np.array([2**32, 2**32 + 1]), np.array([0, 1]))
    assert (i.tolist(), j.tolist()) == ([0, 1], [0, 1])


def test_pair_by_counter_compares_all_32_bits() -> None:
    assert channel.pair_by_counter([5], [5 + 2**31])[0].size == 0


def test_pair_by_counter_leaves_duplicates_out() -> None:
    i, j = channel.pair_by_counter([1, 2, 2, 3, 4], [4, 3, 3, 2, 1])
    assert (i.tolist(), j.tolist()) == ([0, 4], [4, 0])


def test_pair_by_counter_of_nothing() -> None:
    i, j = channel.pair_by_counter([], [1, 2])
    assert i.size == j.size == 0


def test_pair_by_time_respects_the_lag_range() -> None:
    forward = np.array([0.0, 0.010, 0.020, 0.030])
    reverse = np.array([0.0003, 0.0101, 0.0206, 0.0309])
    i, j = channel.pair_by_time(forward, reverse, 130e-6, 650e-6)
    assert (i.tolist(), j.tolist()) == ([0, 2], [0, 2])


def test_pair_by_time_uses_each_reverse_packet_once() -> None:
    i, j = channel.pair_by_time([0.0, 0.0002], [0.0004], 0.0001, 0.001)
    assert (i.tolist(), j.tolist()) == ([1], [0])


def test_pair_by_time_of_unsorted_series() -> None:
    i, j = channel.pair_by_time([0.02, 0.0], [0.0205, 0.0005], 1e-4, 1e-3)
    assert (i.tolist(), j.tolist()) == ([1, 0], [1, 0])


def test_strongest_antenna_by_power() -> None:
    csi = np.ones((4, 30, 3), np.complex128)
    csi[..., 1] = 30j
    csi[..., 2] = 3
    assert channel.strongest_antenna(csi) == 1
    with pytest.raises(ValueError, match="antennas"):
        channel.strongest_antenna(np.ones((4, 30)))


def test_bounded_amplitude_keeps_phases_and_cuts_bursts() -> None:
    values = np.array([0.1, 1, 1, 1, 50]) * np.exp(1j * np.arange(5))
    bounded = channel.bounded_amplitude(values)
    np.testing.assert_allclose(np.angle(bounded * np.exp(-1j * np.arange(5))), 0, atol=1e-12)
    np.testing.assert_allclose(np.abs(bounded), [0.1, 1, 1, 1, 1])
