"""Centres that are remembered are those that would be computed, to the last digit."""

from __future__ import annotations

import numpy as np

from companion.sensing.centres import Centres
from wsr.channel import centre_channel
from wsr.ofdm import GRID_5300, Grid


def test_apertures_that_share_packets_have_the_centres_of_each_alone() -> None:
    rng = np.random.default_rng(4)
    stamps = (np.arange(300) * 10_000 + 2**32 - 1_000_000) % 2**32
    csi = rng.normal(size=(300, 30, 2)).astype(np.float32).view(np.complex64)[..., 0]
    centres = Centres()
    for first, after in ((0, 200), (40, 210), (40, 210), (100, 101), (250, 300), (0, 300)):
        part = slice(first, after)
        np.testing.assert_array_equal(
            centres.of(stamps[part], csi[part], GRID_5300), centre_channel(csi[part], GRID_5300)
        )
    assert not centres.of(stamps[:0], csi[:0], GRID_5300).size


def test_a_packet_is_known_by_its_channel_and_grid_too() -> None:
    rng = np.random.default_rng(5)
    one, other = rng.normal(size=(2, 20, 30, 2)).astype(np.float32).view(np.complex64)[..., 0]
    stamps, centres = np.arange(20), Centres()
    centres.of(stamps, one, GRID_5300)
    np.testing.assert_array_equal(centres.of(stamps, other, GRID_5300), centre_channel(other))
    shifted = Grid(GRID_5300.k + 1.0, GRID_5300.step, GRID_5300.lag, GRID_5300.first)
    np.testing.assert_array_equal(centres.of(stamps, other, shifted), centre_channel(other, shifted))
