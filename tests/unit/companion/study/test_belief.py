"""Beliefs against the truth: drawn from their own covariance they hold as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from companion.core.messages import Vector3
from companion.guidance.tracker import Target
from companion.study.belief import Belief, belief_of, check, share_in_band

FROM_M: Vector3 = (1.0, 2.0, 1.5)


def _truths(belief: Belief, count: int) -> list[Vector3]:
    rng = np.random.default_rng(1)
    drawn = rng.multivariate_normal(belief.mean_m, belief.covariance_m2, count).tolist()
    return [(x, y, z) for x, y, z in drawn]


def test_truths_drawn_from_a_belief_are_held_as_often_as_it_says() -> None:
    root = np.array([[0.8, 0.1, 0.0], [0.2, 0.3, 0.1], [0.0, 0.1, 0.2]])
    belief = Belief(np.array([9.0, -4.0, 0.5]), root @ root.T)
    checks = [check(belief, truth, FROM_M) for truth in _truths(belief, 4000)]
    assert np.mean([c.nees for c in checks]) == pytest.approx(3.0, abs=0.15)
    assert np.mean([c.range_held for c in checks]) == pytest.approx(0.9, abs=0.02)
    assert np.mean([c.direction_held for c in checks]) == pytest.approx(0.9, abs=0.02)


def test_a_truth_behind_the_vehicle_is_no_held_direction() -> None:
    belief = Belief(np.array([4.0, 0.0, 0.0]), np.eye(3))
    behind = check(belief, (-4.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert (behind.range_held, behind.direction_held, behind.nees) == (True, False, 64.0)
    assert check(belief, (12.0, 0.0, 0.0), (0.0, 0.0, 0.0))[1:] == (False, True)


def test_the_belief_is_the_likeliest_source_where_the_target_has_come_to() -> None:
    covariance = ((4.0, 0.1, 0.0), (0.1, 1.0, 0.0), (0.0, 0.0, 0.5))
    belief = belief_of(
        Target(
            t_mono_ns=0,
            azimuth_rad=0.0,
            origin_local_enu_m=(5.0, 2.0, 1.5),
            covariance_m2=covariance,
            boot=7,
            range_m=10.0,
            range_std_m=2.0,
            probability=0.9,
        ),
        (6.0, 0.0, 0.0),
    )
    assert belief.mean_m.tolist() == [11.0, 2.0, 1.5] and belief.covariance_m2.tolist() == [list(r) for r in covariance]


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
