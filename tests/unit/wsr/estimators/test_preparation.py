"""From packets to bins: what is kept, and what each packet counts with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, aperture_towards, exchange, far, weave
from wsr.aperture import make_aperture
from wsr.errors import ApertureError
from wsr.estimators.options import RobustOptions
from wsr.estimators.preparation import counted_amplitude, prepare, takes_first_path
from wsr.geometry import direction
from wsr.ofdm import UNIT_HZ

U = direction(2.1, 1.35)
OPTIONS = RobustOptions()


def test_bins_of_the_one_way_channel_hold_the_path() -> None:
    t, p = weave(1500)
    prepared = prepare(aperture_towards(t, p, far(p, U), noise=0.0), OPTIONS)
    bins = prepared.bins
    assert prepared.wavelength_m == WAVELENGTH_M
    assert prepared.dropped == {}
    assert bins.counts.sum() == 1500
    assert len(bins.counts) < 600
    assert bins.channel.shape[1] == prepared.grid.size == 30
    # All in phase once the way from each bin is taken out.
    turned = bins.channel[:, 14] * np.exp(-2j * np.pi / WAVELENGTH_M * (bins.p_m @ U))
    assert abs(turned.sum()) > 0.98 * np.abs(turned).sum()
    assert np.all(np.diff(prepared.bin_t_s) > 0)


def test_the_product_has_half_the_wavelength() -> None:
    t, p = weave(400)
    aperture = aperture_towards(t, p, far(p, U))
    assert prepare(aperture, replace(OPTIONS, one_way=False)).wavelength_m == WAVELENGTH_M / 2
    single = prepare(aperture, replace(OPTIONS, wideband=False, path_bins=False))
    assert single.bins.channel.shape == (400, 1)
    assert single.grid.size == 1


def test_packets_whose_ends_disagree_are_dropped_and_counted() -> None:
    t, p = weave(400)
    forward, reverse = exchange(p, far(p, U))
    rng = np.random.default_rng(3)
    reverse[:100] = rng.normal(size=(100, 30)) + 1j * rng.normal(size=(100, 30))
    aperture = make_aperture(t, p, (forward * reverse).mean(1), WAVELENGTH_M, forward=forward, reverse=reverse)
    prepared = prepare(aperture, OPTIONS)
    assert prepared.dropped == {"ends disagree": 100}
    assert prepared.bins.counts.sum() == 300
    reverse[:390] = rng.normal(size=(390, 30)) + 1j * rng.normal(size=(390, 30))
    few = make_aperture(t, p, (forward * reverse).mean(1), WAVELENGTH_M, forward=forward, reverse=reverse)
    with pytest.raises(ApertureError, match="only 10 of 400 packets are consistent; needs at least"):
        prepare(few, OPTIONS)


def test_weak_packets_stay_weak_and_strong_ones_are_alike() -> None:
    amplitude = np.array([0.1, 0.25, 0.5, 1.0, 8.0], np.float32)
    np.testing.assert_allclose(counted_amplitude(amplitude, OPTIONS), [0.2, 0.5, 1.0, 1.0, 1.0])
    np.testing.assert_array_equal(counted_amplitude(amplitude, replace(OPTIONS, unit_power=False)), amplitude)


def test_the_first_path_is_taken_of_wide_bands_alone() -> None:
    t, p = weave(200)
    narrow = aperture_towards(t, p, far(p, U))
    hz = np.asarray(np.arange(-120, 121, 4) * UNIT_HZ, np.float64)
    forward, reverse = exchange(p, far(p, U), subcarrier_hz=hz)
    wide = make_aperture(
        t, p, (forward * reverse).mean(1), WAVELENGTH_M, forward=forward, reverse=reverse, subcarrier_hz=hz
    )
    assert takes_first_path(wide, OPTIONS)
    assert not takes_first_path(narrow, OPTIONS)
    for off in (RobustOptions(first_path=False), RobustOptions(one_way=False), RobustOptions(wideband=False)):
        assert not takes_first_path(wide, off)
    assert prepare(wide, OPTIONS).grid.size == 1
