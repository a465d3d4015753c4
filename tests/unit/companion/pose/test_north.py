"""Where North is: the circular mean over a still period, and the refusals."""

from __future__ import annotations

import math
import random

import pytest

from companion.core.clock import NS_PER_S
from companion.pose.north import North, NorthFinder, circular_mean
from tests.unit.companion.pose.turning import yawed_pose


def _fed(north_rad: float, scatter_rad: float, seconds: float, moving_at: int = -1) -> NorthFinder:
    finder, rng = NorthFinder(), random.Random(3)
    for index in range(round(seconds * 20)):
        t_ns = index * NS_PER_S // 20
        tracker_rad = 0.3 + 0.001 * index
        heading_rad = math.remainder(tracker_rad + north_rad + rng.gauss(0, scatter_rad), math.tau)
        finder.add(t_ns, heading_rad, yawed_pose(t_ns, tracker_rad, 0.5 if index == moving_at else 0.0))
    return finder


@pytest.mark.parametrize("north_deg", [0, 40, 179.5, -179.5, -90])
def test_the_mean_turn_is_found_across_the_seam(north_deg: float) -> None:
    north = _fed(math.radians(north_deg), math.radians(1.0), 4.0).north()
    assert isinstance(north, North)
    assert abs(math.remainder(north.yaw_rad - math.radians(north_deg), math.tau)) < math.radians(0.5)
    assert north.scatter_rad == pytest.approx(math.radians(1.0), rel=0.3)


def test_a_scattered_heading_is_refused() -> None:
    refusal = _fed(0.5, math.radians(6.0), 4.0).north()
    assert isinstance(refusal, str) and "scatters by" in refusal and "more than 3" in refusal


def test_a_short_period_or_one_with_motion_is_not_enough() -> None:
    assert "is not known yet" in str(_fed(0.5, 0.0, 2.0).north())
    assert "is not known yet" in str(_fed(0.5, 0.0, 4.0, moving_at=60).north())


def test_circular_mean_of_opposite_angles_has_no_direction() -> None:
    assert circular_mean([0.0, math.pi])[1] > 5
    assert circular_mean([3.1, -3.1])[0] == pytest.approx(math.pi, abs=1e-9)
