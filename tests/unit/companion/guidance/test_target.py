"""What a cloud of places says as a whole, and where a target is by its own poses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.guidance.target import Target, moments, vector, whole_belief

FLAT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0))


def test_moments_count_places_by_their_weights() -> None:
    points = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [9.0, 9.0, 9.0]])
    mean, covariance = moments(points, np.array([3.0, 1.0, 0.0]))
    assert mean == pytest.approx([1.0, 0.0, 0.0])
    assert covariance == pytest.approx(np.diag([3.0, 0.0, 0.0]))


def test_a_belief_says_between_which_ranges_and_how_far_off_the_line_of_sight_it_is() -> None:
    """A hundred places on a line to the East, at 1 to 100 m, and a tenth of the weight to the North."""
    east = np.stack([np.arange(1.0, 101.0), np.zeros(100), np.zeros(100)], axis=1)
    north = np.array([[0.0, 50.0, 0.0]])
    weight = np.append(np.full(100, 0.91), 9.0)
    whole = whole_belief(np.vstack([east, north]), weight, np.zeros(3), np.array([1.0, 0.0, 0.0]))
    near, far = whole.range_90_m
    assert near == pytest.approx(6.0, abs=1.0)
    assert far == pytest.approx(95.0, abs=1.0)
    assert whole.direction_90_rad == pytest.approx(0.0, abs=1e-6), "nine tenths lie exactly there"
    heavier = whole_belief(
        np.vstack([east, north]), np.append(np.full(100, 0.8), 20.0), np.zeros(3), np.array([1.0, 0.0, 0.0])
    )
    assert heavier.direction_90_rad == pytest.approx(math.pi / 2)


def test_a_target_moves_with_its_own_poses() -> None:
    cloud = whole_belief(np.ones((2, 3)), np.ones(2), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    target = Target(
        t_mono_ns=0, azimuth_rad=0.0, origin_local_enu_m=(5.0, -1.0, 0.5), covariance_m2=FLAT, boot=1, range_m=5.0,
        range_std_m=1.0, probability=0.9, whole=cloud,
    )  # fmt: skip
    assert target.place((0.0, 0.0, 0.0)) == (5.0, -1.0, 0.5)
    assert target.place((1.0, 2.0, -0.5)) == (6.0, 1.0, 0.0)


def test_a_vector_is_three_plain_numbers() -> None:
    assert vector(np.array([1, 2, 3], np.int64)) == (1, 2, 3)
    with pytest.raises(ValueError, match="unpack"):
        vector(np.ones(4))
