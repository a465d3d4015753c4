"""Positions at packet times, lever arm, displacement."""

from __future__ import annotations

import math

import numpy as np

from wsr.displacement import antenna_position, antenna_positions, interpolate, relative_displacement
from wsr.geometry import quaternion_from_yaw

POSE_T = np.array([0.0, 0.1, 0.2, 1.0])
POSES = np.array([[0, 0, 0], [1, 2, 3], [2, 2, 2], [10, 2, 2]], float)


def test_linear_between_poses_and_exact_on_them() -> None:
    values, valid = interpolate([0.05, 0.1, 0.2], POSE_T, POSES, 0.15)
    assert valid.all()
    np.testing.assert_allclose(values, [[0.5, 1.0, 1.5], [1.0, 2.0, 3.0], [2.0, 2.0, 2.0]])


def test_nothing_outside_and_nothing_over_a_gap() -> None:
    values, valid = interpolate([-0.01, 0.5, 1.01, 1.0], POSE_T, POSES, 0.15)
    assert valid.tolist() == [False, False, False, True]
    assert np.isnan(values[:3]).all()
    assert interpolate([0.5], POSE_T, POSES, 0.9)[1].all()


def test_the_gap_is_limited_to_what_was_given() -> None:
    assert interpolate([0.15], POSE_T, POSES, 0.1 + 1e-9)[1].all()
    assert not interpolate([0.15], POSE_T, POSES, 0.099)[1].any()
    assert not interpolate([0.6], POSE_T, POSES, 0.79)[1].any()


def test_poses_without_a_time_are_ignored() -> None:
    values, valid = interpolate([0.5], [0.0, np.nan, 1.0], [[0, 0, 0], [9, 9, 9], [1, 2, 3]], 2.0)
    assert valid.all()
    np.testing.assert_allclose(values, [[0.5, 1.0, 1.5]])
    assert not interpolate([0.5], [0.0, 0.9, np.inf], np.zeros((3, 3)), 0.3)[1].any()


def test_duplicates_disorder_and_nan_poses_are_tolerated() -> None:
    t = np.array([0.2, 0.0, 0.1, 0.1, 0.15])
    p = np.array([[2, 0, 0], [0, 0, 0], [1, 0, 0], [9, 0, 0], [np.nan, 0, 0]])
    values, valid = interpolate([0.05, 0.1, 0.15], t, p, 0.2)
    assert valid.all()
    np.testing.assert_allclose(values[:, 0], [0.5, 1.0, 1.5])


def test_without_poses_nothing_is_valid() -> None:
    values, valid = interpolate([0.0, 1.0], [], np.empty((0, 3)), 1.0)
    assert values.shape == (2, 3)
    assert not valid.any()


def test_lever_arm_turns_with_the_body() -> None:
    q = quaternion_from_yaw(np.array([0.0, math.pi / 2]))
    got = antenna_positions([[5, 5, 1], [5, 5, 1]], q, [0.2, 0.0, 0.1])
    np.testing.assert_allclose(got, [[5.2, 5, 1.1], [5, 5.2, 1.1]], atol=1e-12)


def test_a_single_lever_arm_turns_as_many_do() -> None:
    draw = np.random.default_rng(2)
    for _ in range(20):
        p_m, q, lever_m = draw.normal(size=3), draw.normal(size=4), draw.normal(size=3)
        q /= np.linalg.norm(q)
        one = antenna_position(tuple(p_m.tolist()), tuple(q.tolist()), tuple(lever_m.tolist()))
        np.testing.assert_allclose(one, antenna_positions(p_m, q, lever_m), rtol=1e-12, atol=1e-12)


def test_displacement_of_moving_ends_ignores_their_origins() -> None:
    p_i = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float)
    p_j = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0]], float)
    expected = [[0, 0, 0], [1, -1, 0], [2, -2, 0]]
    np.testing.assert_allclose(relative_displacement(p_i + 7, p_j - [3, 4, 5], reference=0), expected)
    centred = relative_displacement(p_i, p_j)
    np.testing.assert_allclose(centred.mean(axis=0), 0, atol=1e-15)
    np.testing.assert_allclose(relative_displacement(p_i, None, 2)[0], [-2, 0, 0])
