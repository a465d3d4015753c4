from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.antenna_height import AntennaHeight
from companion.guidance.tracker import TargetTracker
from tests.unit.companion.guidance.test_tracker import bearing_to


def test_a_height_that_is_expected_counts_once_however_often_it_is_looked_at() -> None:
    heights, told = AntennaHeight(0.5), np.zeros(3)
    at_m = np.array([0.5, 0.7, 1.5])
    total = np.zeros(3)
    for _ in range(5):
        total += heights.log_seen_again(at_m, 0.2, told)
        told = heights.log_prior(at_m)
    assert total == pytest.approx([0.0, -0.5, -12.5])


def test_drift_makes_it_less_sure() -> None:
    heights = AntennaHeight(0.5)
    heights.wander(0.2)
    assert heights.log_prior(np.array([0.9])) == pytest.approx([-1.0])
    heights.begin_anew()
    assert heights.log_prior(np.array([0.9])) == pytest.approx([-2.0])


def test_without_one_what_is_far_below_ground_becomes_unlikely_with_each_aperture() -> None:
    heights = AntennaHeight(None)
    seen = heights.log_seen_again(np.array([-0.7, -0.1, 3.0]), 0.5, np.zeros(3))
    assert seen == pytest.approx([-1.0, 0.0, 0.0])
    assert heights.log_prior(np.array([-0.7, 4.0])) == pytest.approx([0.0, -2.0])


def test_a_robot_on_the_ground_shows_its_range_by_how_far_below_it_is_seen() -> None:
    """On a flight straight at it bearings do not cross, and the wave's curvature tells little. On the average over
    places: one belief is a draw of particles."""
    ratios, errors_m = [], []
    for east_m in np.linspace(0.6, 2.1, 6):
        target, stds_m = np.array([east_m, 0.0, 0.5]), []
        for height_m in (None, 0.5):
            tracker = TargetTracker(antenna_height_m=height_m)
            for leg in range(8):
                place = np.array([-2.25 + 0.25 * leg, 0.0, 1.5])
                range_m = float(np.linalg.norm(target - place))
                seen = replace(bearing_to(target, place, leg / 2), range_m=range_m, range_std_m=0.1 * range_m**2)
                found = tracker.add(replace(seen, fresh=0.2), 0.0)
            stds_m.append(found.range_std_m)
        ratios.append(stds_m[1] / stds_m[0])
        errors_m.append(abs(found.range_m - range_m) / found.range_std_m)
    assert np.exp(np.mean(np.log(ratios))) < 0.85, ratios
    assert max(errors_m) < 2.0, errors_m


def test_an_expected_height_says_nothing_where_the_ground_is_not_known() -> None:
    target = np.array([4.0, 1.0, 0.5])
    tracker = TargetTracker(antenna_height_m=0.5)
    for leg in range(4):
        found = tracker.add(bearing_to(target, np.array([0.0, float(leg), 1.5]), 3 * leg))
    assert found.probability > 0.5 and abs(found.origin_local_enu_m[0] - 4.0) < 1.5
