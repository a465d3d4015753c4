"""Beliefs against the truth: drawn from their own covariance they hold as often as they say."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from companion.core.messages import Vector3
from companion.guidance.target import Target, whole_belief
from companion.study.belief import PLACE_DEGREES, check, share_in_band
from companion.study.chi_square import middle_95
from tests.unit.companion.guidance.stone_soup import nees, particles_of, state_of

FROM_M: Vector3 = (1.0, 2.0, 1.5)
TARGET_M: Vector3 = (2.0, -1.0, 0.5)
"""What the target's own poses say."""


def _two_sources(count: int) -> npt.NDArray[np.float64]:
    """Origins (N, 3): two thirds of them ahead, the others at an image."""
    rng = np.random.default_rng(1)
    root = np.array([[0.8, 0.1, 0.0], [0.2, 0.3, 0.1], [0.0, 0.1, 0.2]])
    ahead = rng.normal(size=(count, 3)) @ root + np.array([7.0, -3.0, 0.0])
    image = rng.normal(size=(count, 3)) @ root + np.array([-4.0, 12.0, 1.0])
    return np.asarray(np.where(rng.uniform(size=(count, 1)) < 2 / 3, ahead, image))


def _target(origins_m: npt.NDArray[np.float64], likeliest_m: Vector3) -> Target:
    here_m = np.subtract(FROM_M, TARGET_M)
    offset_m = np.subtract(likeliest_m, here_m)
    range_m = float(np.linalg.norm(offset_m))
    return Target(
        t_mono_ns=0,
        azimuth_rad=0.0,
        origin_local_enu_m=likeliest_m,
        covariance_m2=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        boot=7,
        range_m=range_m,
        range_std_m=1.0,
        probability=0.67,
        whole=whole_belief(origins_m, np.full(len(origins_m), 1 / len(origins_m)), here_m, offset_m / range_m),
    )


def test_truths_drawn_from_a_belief_of_two_sources_are_held_as_often_as_it_says() -> None:
    target = _target(_two_sources(20000), (7.0, -3.0, 0.0))
    truths = (_two_sources(4000)[::-1] + np.array(TARGET_M)).tolist()
    checks = [check(target, TARGET_M, (x, y, z), FROM_M) for x, y, z in truths]
    assert np.mean([c.nees for c in checks]) == pytest.approx(3.0, abs=0.15)
    assert np.mean([c.range_held for c in checks]) == pytest.approx(0.9, abs=0.02)
    assert np.mean([c.direction_held for c in checks]) == pytest.approx(0.9, abs=0.02)


def test_a_truth_behind_the_vehicle_is_no_held_direction() -> None:
    rng = np.random.default_rng(3)
    target = _target(rng.normal(size=(4000, 3)) * 0.3 + np.array([5.0, 3.0, 1.0]), (5.0, 3.0, 1.0))
    ahead_m = np.add((5.0, 3.0, 1.0), TARGET_M)
    behind_m = 2 * np.array(FROM_M) - ahead_m
    (x, y, z), (u, v, w) = ahead_m.tolist(), behind_m.tolist()
    assert check(target, TARGET_M, (x, y, z), FROM_M)[1:] == (True, True)
    assert check(target, TARGET_M, (u, v, w), FROM_M)[1:] == (True, False)


def test_the_mean_of_a_consistent_belief_is_in_its_band_and_others_are_not() -> None:
    rng = np.random.default_rng(2)
    missions = rng.chisquare(3, (40, 200)).tolist()
    share = share_in_band(missions, 5)
    assert share is not None
    assert share == pytest.approx(0.95, abs=0.04)
    assert share_in_band([[3 * value for value in mission] for mission in missions], 5) == 0.0
    assert share_in_band([[value / 3 for value in mission] for mission in missions], 5) == 0.0
    assert share_in_band(missions[:4], 5) is None
    assert share_in_band([], 1) is None


def test_moments_and_nees_are_those_of_stone_soup() -> None:
    """On the same particles and the same truths, to numerical precision; and so is whether their mean lies in its
    band, which Stone Soup's own gates give for as many degrees."""
    from stonesoup.hypothesiser.probability import PDAHypothesiser

    rng = np.random.default_rng(4)
    missions: list[list[float]] = []
    oracle: list[list[float]] = []
    for mission in range(30):
        origins_m = _two_sources(400)[rng.permutation(400)[:200]] * rng.uniform(0.2, 3.0)
        target = _target(origins_m, (7.0, -3.0, 0.0))
        particles = particles_of(origins_m)
        whole = target.whole
        np.testing.assert_allclose(whole.origin_local_enu_m, np.asarray(particles.mean, float).reshape(3), rtol=1e-12)
        np.testing.assert_allclose(whole.covariance_m2, particles.covar, rtol=1e-10)
        belief = state_of(np.add(whole.origin_local_enu_m, TARGET_M), np.array(whole.covariance_m2))
        # As wide as it says; in every third mission, far too wide or too narrow.
        scale = (1.0, 0.3, 3.0)[mission % 3]
        root = np.linalg.cholesky(np.array(whole.covariance_m2))
        truths_m = np.asarray(belief.mean, float).reshape(3) + scale * rng.normal(size=(3, 3)) @ root.T
        missions.append([check(target, TARGET_M, (x, y, z), FROM_M).nees for x, y, z in truths_m.tolist()])
        oracle.append([nees(belief, truth_m) for truth_m in truths_m])
    np.testing.assert_allclose(missions, oracle, rtol=1e-9)
    for kind in range(3):
        mean = np.mean(oracle[kind::3], axis=0)
        degrees = PLACE_DEGREES * len(oracle[kind::3])
        low, high = (PDAHypothesiser._gate_threshold(share, degrees) for share in (0.025, 0.975))
        np.testing.assert_allclose(middle_95(degrees), (low, high), rtol=1e-12)
        inside = float(np.mean((low <= degrees / 3 * mean) & (degrees / 3 * mean <= high)))
        assert share_in_band(missions[kind::3], 10) == inside
