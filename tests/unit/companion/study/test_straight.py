"""Straight flight with perfect knowledge, where its time can be told by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.study.straight import straight_flight_s
from tests.sim_scenes import scene


def test_a_standing_robot_takes_the_way_at_speed_and_half_the_ramp() -> None:
    standing = replace(scene(), drive_speed_m_s=0.0)
    took_s = straight_flight_s(standing, (0.0, 0.0, 0.5), (0.0, 0.0, 0.5), 2.0, speed_m_s=0.5, acceleration_m_s2=0.8)
    assert took_s == pytest.approx(13.0 / 0.5 + 0.5 / 0.8 / 2, abs=0.1)


def test_a_vehicle_that_begins_later_comes_later_by_as_much() -> None:
    standing = replace(scene(), drive_speed_m_s=0.0)
    at_once, later = (
        straight_flight_s(
            standing, (0.0, 0.0, 0.5), (0.0, 0.0, 0.5), 2.0, speed_m_s=0.5, acceleration_m_s2=0.8, begins_s=begins_s
        )
        for begins_s in (0.0, 1.0)
    )
    assert later == pytest.approx(at_once + 1.0)


def test_a_robot_that_drives_off_is_caught_at_the_difference_of_speeds() -> None:
    away = replace(scene(), beacon_azimuth_rad=0.0, drive_azimuth_rad=0.0, drive_speed_m_s=0.2, drive_after_m=0.01)
    took_s = straight_flight_s(away, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 2.0, speed_m_s=0.5, acceleration_m_s2=0.8)
    assert took_s == pytest.approx(13.0 / 0.3, rel=0.03)


def test_a_robot_that_is_faster_is_never_caught() -> None:
    fast = replace(scene(), beacon_azimuth_rad=0.0, drive_azimuth_rad=0.0, drive_speed_m_s=1.0, drive_after_m=0.01)
    assert (
        straight_flight_s(fast, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 2.0, speed_m_s=0.5, acceleration_m_s2=0.8) == math.inf
    )
