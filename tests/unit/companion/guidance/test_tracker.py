"""Bearings that cross make a position, and others do not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.tracker import TargetTracker
from companion.sensing.records import Bearing


def bearing_to(
    target: np.ndarray,
    place: np.ndarray,
    t_s: float,
    own: np.ndarray | None = None,
    turned: tuple[float, float] = (0, 0),
) -> Bearing:
    """A bearing that is off by `turned` [rad]; `own` is where the target's own poses put it."""
    x, y, z = target - place
    polar_rad = math.acos(z / np.linalg.norm(target - place)) + turned[1]
    own_m = tuple(np.zeros(3) if own is None else own)
    azimuth_rad = math.atan2(y, x) + turned[0]
    return Bearing(
        t_mono_ns=round(t_s * 1e9),
        p_local_enu_m=tuple(place),
        azimuth_rad=azimuth_rad,
        polar_rad=polar_rad,
        azimuth_std_rad=0.02,
        polar_std_rad=0.02,
        target_p_enu_m=own_m,
        target_boot=7,
        reliability=0.9,
    )


def test_bearings_from_the_side_make_a_position() -> None:
    tracker = TargetTracker()
    target = np.array([6.0, 3.0, 0.5])
    places = [np.array([0.0, y, 1.5]) for y in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    assert math.isinf(tracker.add(bearing_to(target, places[0], 0)).range_std_m)
    for number, place in enumerate(places[1:], 1):
        found = tracker.add(bearing_to(target, place, 3 * number))
    assert found.origin_local_enu_m is not None
    np.testing.assert_allclose(found.origin_local_enu_m, target, atol=0.7)
    assert found.range_m == pytest.approx(np.linalg.norm(target - places[-1]), rel=0.12)
    assert found.range_std_m < 2.0


@pytest.mark.parametrize("seed", range(10))
def test_a_flight_straight_at_the_target_is_near_only_when_it_is(seed: int) -> None:
    """Bearings along one line tell no range: beside the vehicle is as good a place as far away."""
    rng = np.random.default_rng(seed)
    tracker, target = TargetTracker(), np.array([14.0, 0.0, 0.3])
    for leg in range(16):
        place = np.array([0.85 * leg, 0.0, 1.5])
        a, p = np.radians(4) * rng.standard_normal(2)
        found = tracker.add(bearing_to(target, place, 3.5 * leg, turned=(a, p)))
        away_m = float(np.linalg.norm(target - place))
        if away_m > 2.0:
            assert found.range_m + 2 * found.range_std_m > 1.5, f"taken for near at {away_m:.1f} m"
        assert leg < 3 or abs(found.azimuth_rad) < math.radians(10)
    for turn in range(8):  # around it: now it is near, and that is seen
        place = target + np.array([0.7 * math.cos(turn), 0.7 * math.sin(turn), 0.6])
        found = tracker.add(bearing_to(target, place, 60 + 3 * turn))
    assert found.range_m + 2 * found.range_std_m < 1.5


def test_a_bearing_that_disagrees_is_outvoted() -> None:
    tracker, target = TargetTracker(), np.array([14.0, 0.0, 0.3])
    for leg in range(5):
        found = tracker.add(bearing_to(target, np.array([0.85 * leg, 0.0, 1.5]), 3.5 * leg))
    outlier = bearing_to(target, np.array([0.85 * 5, 0.0, 1.5]), 17.5, turned=(1.2, 0.2))
    found = tracker.add(outlier)
    assert abs(found.azimuth_rad) < math.radians(3)
    # A target that has really gone elsewhere is followed once the new bearings outweigh the old.
    elsewhere = np.array([0.85 * 5, 10.0, 0.3])
    for leg in range(8):
        found = tracker.add(bearing_to(elsewhere, np.array([0.85 * 5, 0.5 * leg, 1.5]), 20 + 3.5 * leg))
    assert found.azimuth_rad == pytest.approx(math.pi / 2, abs=math.radians(3))


def test_a_target_that_drives_across_is_not_taken_for_near() -> None:
    """Standing it would have to be at 2.6 m to turn that fast; its own poses tell that it moved."""
    tracker = TargetTracker()
    origin = np.array([-40.0, 9.0, 2.0])
    for leg in range(6):
        target = np.array([8.0, 0.4 * leg, 0.3])
        found = tracker.add(bearing_to(target, np.array([0.7 * leg, 0.0, 1.5]), 3.5 * leg, target - origin))
    place, own = (3.5, 0.0, 1.5), (48.0, -7.0, -1.7)
    there, on_the_way = found.place(own), found.place((49.0, -7.0, -1.7))
    assert there is not None and on_the_way is not None
    assert math.dist(place, there) > 4.0
    assert math.dist((4.5, 0.0, 1.5), on_the_way) == pytest.approx(math.dist(place, there), abs=1e-6)


def test_a_bearing_without_polar_angle_still_crosses_from_the_side() -> None:
    tracker, target = TargetTracker(), np.array([6.0, 3.0, 0.5])
    for y in range(7):
        flat = bearing_to(target, np.array([0.0, float(y), 1.5]), y)
        found = tracker.add(replace(flat, polar_rad=math.pi / 2, polar_std_rad=math.inf) if y else flat)
    assert found.origin_local_enu_m is not None
    np.testing.assert_allclose(found.origin_local_enu_m[:2], target[:2], atol=1.0)


def test_a_rebooted_target_has_another_origin() -> None:
    tracker = TargetTracker()
    target = np.array([6.0, 3.0, 0.5])
    tracker.add(bearing_to(target, np.array([0.0, 0.0, 1.5]), 0))
    tracker.add(bearing_to(target, np.array([0.0, 3.0, 1.5]), 3))
    found = tracker.add(replace(bearing_to(target, np.array([1.0, 3.0, 1.5]), 6), target_boot=8))
    assert found.origin_local_enu_m is None
    assert found.boot == 8


def test_lines_that_cross_behind_give_no_range() -> None:
    tracker = TargetTracker()
    tracker.add(bearing_to(np.array([-1.0, 5.0, 1.0]), np.array([0.0, 0.0, 1.0]), 0))
    found = tracker.add(bearing_to(np.array([2.0, 5.0, 1.0]), np.array([1.0, 0.0, 1.0]), 1))
    assert found.range_std_m > 3.0
