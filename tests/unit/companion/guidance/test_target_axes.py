"""A driving target's way is turned by what it takes for North."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.target_axes import AXES_STD_RAD, bend_rad, carried_m, drawn_axes, jumped_m
from companion.guidance.tracker import TargetTracker
from companion.sensing.frame_turn import FrameTurn
from companion.sensing.records import Bearing
from companion.study.belief import check
from tests.unit.companion.guidance.test_tracker import bearing_to


def test_a_way_goes_on_where_its_axes_turn_it() -> None:
    told_m = np.array([2.0, 0.0, 0.3])
    more_m = carried_m(np.array([0.0, math.pi / 2, -math.pi / 6]), told_m)
    ways_m = [(2.0, 0.0, 0.3), (0.0, 2.0, 0.3), (math.sqrt(3.0), -1.0, 0.3)]
    np.testing.assert_allclose(told_m + more_m, ways_m, atol=1e-12)


def test_axes_are_as_uncertain_as_north_is() -> None:
    drawn = drawn_axes(np.random.default_rng(1), 4000)
    assert float(np.std(drawn)) == pytest.approx(AXES_STD_RAD, rel=0.05)
    assert float(np.mean(drawn)) == pytest.approx(0.0, abs=0.1 * AXES_STD_RAD)


@pytest.mark.parametrize(
    ("ours_m", "its_m", "share"),
    [((1.0, 0.0), (0.0, 0.0), 0.0), ((0.0, 0.0), (0.0, 1.0), 1.0), ((0.0, 0.0), (1.0, 0.0), 0.0),
     ((3.0, 0.5), (0.0, 0.5), 0.5 / 3.0), ((0.0, 0.0), (0.0, 0.0), 0.0)],
)  # fmt: skip
def test_only_what_a_target_drives_across_bends_a_bearing(
    ours_m: tuple[float, float], its_m: tuple[float, float], share: float
) -> None:
    """It is seen in the east. An aperture's path is ours less its own."""
    before, after = _seen_in_the_east(ours_m, its_m)
    known = replace(after, turn=FrameTurn(0.0, 0.0))
    assert bend_rad(before, known) == pytest.approx(AXES_STD_RAD * share)
    turned = replace(after, turn=FrameTurn(0.2, 0.1))
    assert bend_rad(before, turned) == pytest.approx(math.hypot(AXES_STD_RAD, 0.2, 0.1) * share)


def test_a_way_that_nobody_drives_is_a_jump() -> None:
    before, after = _seen_in_the_east((0.3, 0.0), (0.0, 8.0))
    np.testing.assert_allclose(jumped_m(before, after), (0.0, 8.0, 0.0))
    much_later = replace(after, t_mono_ns=10_000_000_000)
    assert not jumped_m(before, much_later).any()


def test_a_target_that_drives_across_is_not_taken_for_near() -> None:
    """Standing it would have to be at 2.6 m to turn that fast; its own poses tell that it moved."""
    tracker = TargetTracker()
    origin = np.array([-40.0, 9.0, 2.0])
    for leg in range(6):
        target = np.array([8.0, 0.4 * leg, 0.3])
        found = tracker.add(bearing_to(target, np.array([0.7 * leg, 0.0, 1.5]), 3.5 * leg, target - origin))
    place, own = (3.5, 0.0, 1.5), (48.0, -7.0, -1.7)
    there, on_the_way = found.place(own), found.place((49.0, -7.0, -1.7))
    assert math.dist(place, there) > 3.0
    assert math.dist((4.5, 0.0, 1.5), on_the_way) == pytest.approx(math.dist(place, there), abs=1e-6)


@pytest.mark.parametrize("turned_deg", [-15.0, 15.0])
def test_what_a_driving_target_takes_for_north_is_not_believed(turned_deg: float) -> None:
    """Its own poses turn its way by as much: it is elsewhere than they say."""
    tracker, start_m = TargetTracker(antenna_height_m=0.5), np.array([10.0, 3.0, 0.5])
    c, s, checks = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg)), []
    for step in range(40):
        gone_m = np.array([0.3, 0.2, 0.0]) * step
        behind_m = 10.0 - 0.2 * step
        place = np.array([start_m[0] + gone_m[0] - behind_m, gone_m[1] + 0.6 * math.sin(0.5 * step), 1.5])
        own_m = np.array([c * gone_m[0] - s * gone_m[1], s * gone_m[0] + c * gone_m[1], 0.0])
        found = tracker.add(bearing_to(start_m + gone_m, place, float(step), own_m), 0.0)
        checks.append(check(found, tuple(own_m), tuple(start_m + gone_m), tuple(place)))
    assert max(each.nees for each in checks) < 8.0, [round(each.nees, 1) for each in checks]
    assert all(each.direction_held for each in checks)


@pytest.mark.parametrize("jump_m", [(8.0, 0.0, 0.0), (0.0, -8.0, 0.0), (0.0, 5.0, 0.0)])
def test_a_target_whose_poses_jump_is_where_it_was(jump_m: tuple[float, float, float]) -> None:
    """Its camera found itself elsewhere, while it drives. The next bearing takes an aperture of its own."""
    tracker, start_m = TargetTracker(antenna_height_m=0.5), np.array([10.0, 3.0, 0.5])
    for step in range(30):
        place = np.array([0.28 * step, 0.6 * math.sin(0.5 * step), 1.5])
        truth_m = start_m + np.array([0.3, 0.0, 0.0]) * step
        own_m, t_s = truth_m - start_m, float(step)
        if step > 20:
            own_m, t_s = own_m + jump_m, t_s + 2.0
        found = tracker.add(bearing_to(truth_m, place, t_s, own_m), 0.0)
        x, y, z = own_m.tolist()
        assert step < 18 or math.dist(found.place((x, y, z)), truth_m) < 3.0, step


def test_arrival_allows_for_which_way_a_target_has_driven_since() -> None:
    tracker, target = TargetTracker(antenna_height_m=0.5), np.array([3.0, 0.0, 0.5])
    for step in range(25):
        place = target + np.array([2.0 * math.cos(0.4 * step), 2.0 * math.sin(0.4 * step), 1.0])
        tracker.add(bearing_to(target, place, float(step)), 0.0)
    x, y, z = target.tolist()
    here = tracker.within((x, y, z), (0.0, 0.0, 0.0), 0.8)
    after_a_way = tracker.within((x + 6.0, y, z), (6.0, 0.0, 0.0), 0.8)
    assert here > 0.9 > after_a_way > 0.2


def _seen_in_the_east(ours_m: tuple[float, float], its_m: tuple[float, float]) -> tuple[Bearing, Bearing]:
    """A second apart."""
    before = bearing_to(np.array([9.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.5]), 0.0)
    after = replace(
        before, t_mono_ns=1_000_000_000, p_local_enu_m=(*ours_m, 1.5), target_p_enu_m=(*its_m, 0.0), azimuth_rad=0.0
    )
    return before, after
