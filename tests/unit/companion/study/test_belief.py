"""Beliefs against the truth: drawn from their own covariance they hold as often as they say."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from companion.core.messages import Vector3
from companion.guidance.target import Target, whole_belief
from companion.study.belief import check, share_in_band

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
