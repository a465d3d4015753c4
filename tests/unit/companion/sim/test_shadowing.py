"""A smooth loss of the stated deviation; the radio is so much weaker, in both directions alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.sim.radio import simulate_exchanges
from companion.sim.shadowing import Shadowing
from csi_bridge.scaling import total_rss_dbm
from tests.sim_scenes import CLEAN_RADIO, scene, straight


def _levels_db(seed: int, std_db: float) -> np.ndarray:
    """Along 30 m towards the other end, every 0.1 m."""
    x = np.arange(0.0, 30.0, 0.1)
    a_m = np.stack([x, 0.1 * np.sin(x), 0 * x + 1.5], axis=1)
    return 20 * np.log10(Shadowing(seed, std_db).gain(a_m, np.tile([31.0, 0.0, 0.5], (len(x), 1))))


def test_its_deviation_and_how_soon_it_is_another() -> None:
    levels = np.array([_levels_db(seed, 3.0) for seed in range(80)])
    assert levels.std() == pytest.approx(3.0, rel=0.1)
    near, far = (float(np.mean(levels[:, :-k] * levels[:, k:])) / levels.var() for k in (5, 50))
    assert near > 0.9 and abs(far) < 0.25


def test_the_same_seed_gives_the_same_field() -> None:
    np.testing.assert_array_equal(_levels_db(4, 2.0), _levels_db(4, 2.0))
    assert np.ptp(_levels_db(4, 2.0) - _levels_db(5, 2.0)) > 1.0


def test_both_ends_hear_each_other_so_much_more_softly() -> None:
    uav = straight(np.array([0.0, 0.0, 1.5]), np.array([0.5, 0.0, 0.0]), 1.0, 6.0, yaw_rad=0.0)
    beacon = straight(np.array([12.0, 0.0, 0.5]), np.zeros(3), 1.0, 6.0, yaw_rad=0.0)
    clear = scene(radio=CLEAN_RADIO)
    shaded = replace(clear, radio=replace(CLEAN_RADIO, shadowing_db=4.0))
    expected = [
        20 * np.log10(float(Shadowing(clear.seed, 4.0).gain(uav.p_enu_m[[k]], beacon.p_enu_m[[k]])[0])) for k in (0, -1)
    ]
    heard, faint = (simulate_exchanges(world, uav, beacon) for world in (clear, shaded))
    for before, after in zip(heard, faint, strict=True):
        powers = [[total_rss_dbm(r.rssi, r.agc) for r in side] for side in (before, after)]
        lost = np.subtract(powers[1], powers[0])
        assert [lost[:5].mean(), lost[-5:].mean()] == pytest.approx(expected, abs=0.7)
