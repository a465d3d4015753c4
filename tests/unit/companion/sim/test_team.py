"""The simulated team: bearings err as they say, overlap as they say, and poses drift by as much as is asked for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.sim.team import STEP_S, SeenRobot, TeamWorld, moments

WORLD = TeamWorld(robots=3, duration_s=200.0)


def seen(world: TeamWorld, seed: int = 1) -> tuple[list[SeenRobot], np.ndarray]:
    """All bearings, and their errors of azimuth [rad]."""
    found, errors, past = [], [], {}
    for moment in moments(world, np.random.default_rng(seed)):
        past[round(moment.t_s / STEP_S)] = moment
        for one in moment.told:
            then = past[round(one.t_s / STEP_S)]
            v = then.places_m[one.target] - then.places_m[one.observer]
            true = math.atan2(v[1], v[0]) - then.headings_rad[one.observer]
            found.append(one)
            errors.append(math.remainder(one.azimuth_rad - true, math.tau))
    return found, np.array(errors)


def test_direct_paths_err_by_their_deviation_and_the_others_point_anywhere() -> None:
    found, errors = seen(WORLD)
    std = math.hypot(found[0].azimuth_std_rad, WORLD.azimuth_model_rad)
    near = np.abs(errors) < 4 * std
    assert errors[near].std() == pytest.approx(std, rel=0.15)
    expected = np.mean([0.45 + 0.4 * one.reliability for one in found])
    assert near.mean() == pytest.approx(expected + (1 - expected) * 8 * std / math.tau, abs=0.06)


def test_the_shares_of_new_packets_add_up_to_independent_apertures() -> None:
    """The mean of many overlapping errors scatters as that of so many independent ones."""
    world = replace(WORLD, robots=2, duration_s=60.0)
    means, fresh = [], 0.0
    for seed in range(60):
        found, errors = seen(world, seed)
        std = math.hypot(found[0].azimuth_std_rad, world.azimuth_model_rad)
        mine = np.array([one.observer == 0 for one in found]) & (np.abs(errors) < 4 * std)
        means.append(errors[mine].mean())
        fresh = sum(one.fresh for one, is_mine in zip(found, mine, strict=True) if is_mine)
    assert np.std(means) == pytest.approx(std / math.sqrt(fresh), rel=0.4)


def test_bearings_are_told_late_and_some_are_lost() -> None:
    found, _ = seen(WORLD)
    assert {round(one.told_s - one.t_s, 6) for one in found} == {1.6}
    assert np.mean([one.is_lost for one in found]) == pytest.approx(WORLD.loss, abs=0.04)
    assert {(one.observer, one.target) for one in found} == {(i, j) for i in range(3) for j in range(3) if i != j}
    one_eye, _ = seen(replace(WORLD, observers=frozenset({0})))
    assert {one.observer for one in one_eye} == {0}


def test_own_poses_turn_with_the_axes_and_drift() -> None:
    still = replace(WORLD, drift_m_sqrt_m=0.0, walk_m_sqrt_s=0.0, north_std_rad=0.0, heading_walk_rad_sqrt_s=0.0)
    first, *_, last = moments(still, np.random.default_rng(1))
    np.testing.assert_allclose(last.poses_m - first.poses_m, last.places_m - first.places_m, atol=1e-9)
    turned = replace(still, turning_rad_s=0.01, turning_from_s=0.0, turning_s=10.0)
    *_, last = moments(turned, np.random.default_rng(1))
    assert last.headings_rad.tolist() == pytest.approx([0.0, 0.0, 0.1])
