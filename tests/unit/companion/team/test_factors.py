"""Residuals of sightings: right at the truth, with Jacobians that differences confirm."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.team.factors import Sightings, look, trusted


def sightings(states: np.ndarray, rng: np.random.Generator, count: int = 40) -> Sightings:
    """Exact ones of random pairs."""
    keyframes, robots, _ = states.shape
    observer = rng.integers(robots, size=count)
    target = (observer + rng.integers(1, robots, size=count)) % robots
    keyframe = rng.integers(keyframes, size=count)
    ways = rng.normal(0.0, 0.4, (2, count, 3))
    bare = Sightings(
        keyframe=keyframe,
        observer=observer,
        target=target,
        observer_way_m=ways[0],
        target_way_m=ways[1],
        measured=np.zeros((count, 3)),
        std=np.tile([0.1, 0.2, 0.1], (count, 1)),
        reliability=rng.uniform(size=count),
        fresh=rng.uniform(0.1, 1.0, count),
    )
    foreseen = look(states, bare).residual
    return replace(bare, measured=foreseen)


def some_states(rng: np.random.Generator) -> np.ndarray:
    states = rng.normal(0.0, 6.0, (3, 4, 4))
    states[..., 3] = rng.normal(0.0, 0.3, states.shape[:2])
    return states


def test_a_robot_due_north_is_seen_to_the_left_of_axes_that_are_turned_right() -> None:
    states = np.zeros((1, 2, 4))
    states[0, 1, :3], states[0, 0, 3] = (0.0, 5.0, 5.0), -0.1
    seen = look(states, replace(sightings(states, np.random.default_rng(1), 1), observer=np.array([0]),
                                target=np.array([1]), observer_way_m=np.zeros((1, 3)), target_way_m=np.zeros((1, 3)),
                                measured=np.zeros((1, 3))))  # fmt: skip
    assert seen.residual[0].tolist() == pytest.approx([math.pi / 2 + 0.1, math.pi / 4, 1 / math.sqrt(50)])


def test_at_the_truth_nothing_is_left_and_each_is_trusted_more_than_before() -> None:
    rng = np.random.default_rng(2)
    states = some_states(rng)
    exact = sightings(states, rng)
    seen = look(states, exact)
    np.testing.assert_allclose(seen.residual, 0.0, atol=1e-9)
    assert (seen.direct > trusted(exact.reliability)).all()


def test_jacobians_are_those_of_differences() -> None:
    rng = np.random.default_rng(3)
    states = some_states(rng)
    one = replace(sightings(states, rng), measured=rng.normal(0.0, 0.1, (40, 3)))
    seen, step = look(states, one), 1e-6
    for column in range(8):
        who = one.observer if column < 4 else one.target
        for m in range(len(one)):
            nudged = states.copy()
            nudged[one.keyframe[m], who[m], column % 4] += step
            by_difference = (look(nudged, one).residual[m] - seen.residual[m]) / step
            np.testing.assert_allclose(by_difference, seen.jacobian[m, :, column], atol=1e-4)


def test_a_direction_far_off_is_taken_for_another_path_and_says_nothing() -> None:
    rng = np.random.default_rng(4)
    states = some_states(rng)
    exact = sightings(states, rng, 2)
    off = replace(exact, measured=exact.measured + np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    seen = look(states, off)
    assert seen.direct[0] < 0.01 < seen.direct[1]
    assert seen.information[0, 0] < 0.01 * seen.information[1, 0]


def test_what_was_not_observed_pulls_nothing_and_old_packets_count_by_their_share() -> None:
    rng = np.random.default_rng(5)
    states = some_states(rng)
    exact = sightings(states, rng, 2)
    seen = look(states, replace(exact, std=np.array([[0.1, math.inf, math.inf]] * 2), fresh=np.array([1.0, 0.2]),
                                reliability=np.array([0.5, 0.5])))  # fmt: skip
    assert (seen.information[:, 1:] == 0.0).all()
    assert seen.information[1, 0] == pytest.approx(0.2 * seen.information[0, 0])
