"""A simulated link along any two paths: both cards' records, paired, as the estimators take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from companion.sim.scenario import RadioScenario, ax210_radio
from companion.study.link import CLOCK_OFFSET_S, hear, hear_ax, room, scenario, standing, trajectory
from companion.study.paths import climbing_helix
from wsr.estimators.bartlett import Bartlett
from wsr.geometry import angles, direction, great_circle

_WAY_M = climbing_helix(1.2, 200) + np.array([0.0, 0.0, 1.5])
_TARGET_M = np.array([9.0, 4.0, 1.0])
_CLEAN = RadioScenario(reflectors=())


def test_what_is_heard_points_at_the_robot() -> None:
    uav = trajectory(_WAY_M, 0.6)
    heard = hear(scenario(SeedSequence(1), _CLEAN), uav, standing(_TARGET_M, 0.5, 4.0))
    p_m, _ = uav.at(heard.t_s)
    assert heard.forward.shape == heard.reverse.shape == (len(heard.t_s), 30)
    assert np.all(np.diff(heard.t_s) > 0)
    assert heard.other_t_s - heard.t_s == pytest.approx(CLOCK_OFFSET_S, abs=5e-3)
    estimate, _ = Bartlett().estimate(heard.aperture(p_m))
    truth = direction(*angles(_TARGET_M - np.array(estimate.reference_p_m)))
    assert np.degrees(great_circle(direction(estimate.azimuth_rad, estimate.polar_rad), truth)) < 6.0


def test_some_of_the_exchanges_are_an_aperture_too() -> None:
    uav = trajectory(_WAY_M, 0.6)
    heard = hear(scenario(SeedSequence(1), _CLEAN), uav, standing(_TARGET_M, 0.5, 4.0))
    keep = np.arange(len(heard.t_s)) % 2 == 0
    p_m, _ = uav.at(heard.t_s)
    assert heard.aperture(p_m, p_j_m=np.tile(_TARGET_M, (len(p_m), 1)), keep=keep).packets == keep.sum()


def test_the_same_seed_is_the_same_link() -> None:
    uav, beacon = trajectory(_WAY_M[:20], 0.6), standing(_TARGET_M, 0.5, 4.0)
    first, again, other = (hear(scenario(SeedSequence(s), _CLEAN), uav, beacon) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.forward, again.forward)
    assert not np.array_equal(first.nic_us[:5], other.nic_us[:5])


def test_ax_cards_hear_more_subcarriers_and_may_be_turned_by_half() -> None:
    uav = trajectory(_WAY_M[:40], 0.6)
    world = scenario(SeedSequence(1), ax210_radio(_CLEAN, 80))
    heard = hear_ax(world, uav, standing(_TARGET_M, 0.5, 4.0))
    assert heard.grid is not None
    assert heard.forward.shape == heard.reverse.shape == (len(heard.t_s), heard.grid.size)
    assert heard.grid.size > 100
    p_m, _ = uav.at(heard.t_s)
    assert heard.aperture(p_m).half_turns


def test_a_room_stands_around_both_and_what_occludes_takes_ten_decibels() -> None:
    rng = np.random.default_rng(1)
    open_, closed = (room(np.random.default_rng(1), [np.zeros(3), _TARGET_M], occluded=shut) for shut in (False, True))
    assert open_.direct_gain == 1.0
    assert 20 * np.log10(closed.direct_gain) == pytest.approx(-10.0, abs=0.2)
    assert closed.reflectors == open_.reflectors
    assert open_.reflectors
    assert room(rng, [np.zeros(3)], replace(_CLEAN, tx_power_dbm=7.0)).tx_power_dbm == 7.0
