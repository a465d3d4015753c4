"""One path in two frames: what turns the one into the other, and how well that is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.sensing.frame_turn import NORTH_STD_RAD, UNKNOWN, frame_turn

_DRIFT = 0.025


def _turned(path_m: np.ndarray, yaw_deg: float) -> np.ndarray:
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    return np.asarray(path_m @ np.array([[c, s], [-s, c]]))


def _weave(length_m: float) -> np.ndarray:
    x = np.linspace(0.0, length_m, 4 * max(2, round(length_m / 0.125)))
    return np.stack([x, 0.1 * np.sin(5 * x)], axis=1)


@pytest.mark.parametrize("yaw_deg", [-170.0, -12.0, 0.0, 3.0, 25.0])
def test_a_long_path_shows_the_turn(yaw_deg: float) -> None:
    posed = _turned(_weave(12.0), 40.0)
    found = frame_turn(posed, _turned(posed, yaw_deg) + np.array([5.0, -3.0]), _DRIFT)
    assert math.degrees(found.yaw_rad) == pytest.approx(yaw_deg, rel=0.1, abs=0.1)
    assert math.degrees(found.std_rad) < 2.0


def test_the_shorter_the_path_the_less_is_known_and_the_more_counts_what_was_known_before() -> None:
    found = [
        frame_turn(_weave(length_m), _turned(_weave(length_m), 10.0), _DRIFT) for length_m in (0.5, 1.2, 4.0, 15.0)
    ]
    assert [one.std_rad for one in found] == sorted((one.std_rad for one in found), reverse=True)
    assert [one.yaw_rad for one in found] == sorted(one.yaw_rad for one in found)
    assert all(one.std_rad < NORTH_STD_RAD and 0.0 < one.yaw_rad < math.radians(10.0) for one in found)


def test_a_position_that_does_not_follow_the_path_says_little() -> None:
    path_m = _weave(3.0)
    wandering = path_m + np.random.default_rng(3).normal(0.0, 1.5, path_m.shape)
    assert frame_turn(path_m, wandering, _DRIFT).std_rad > 0.8 * NORTH_STD_RAD


@pytest.mark.parametrize("points", [0, 1, 40])
def test_who_stands_still_learns_nothing(points: int) -> None:
    still = np.random.default_rng(1).normal(0.0, 0.01, (points, 2))
    assert frame_turn(still, still, _DRIFT) == UNKNOWN


def test_the_deviation_is_that_of_the_error_with_poses_that_drift() -> None:
    """Their velocity is off by a share of the speed that changes over a few metres, as a T265's is."""
    rng, errors, drift = np.random.default_rng(7), list[float](), 0.08
    for _ in range(200):
        true_m = _weave(6.0)
        steps = np.diff(true_m, axis=0)
        bias, bent = rng.normal(0.0, drift, 2), [np.zeros(2)]
        for step in steps:
            length_m = float(np.hypot(*step))
            keep = math.exp(-length_m / 2.5)
            bias = keep * bias + math.sqrt(1 - keep**2) * rng.normal(0.0, drift, 2)
            bent.append(step + bias * length_m)
        found = frame_turn(np.cumsum(bent, axis=0), _turned(true_m, 5.0), drift)
        errors.append((found.yaw_rad - math.radians(5.0)) / found.std_rad)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.2
