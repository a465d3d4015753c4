"""Where the beacon stands and drives, and the vehicle's track."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.sim.trajectory import BeaconDrive, VehicleTrack
from tests.sim_scenes import scene


def test_the_beacon_stands_on_its_circle_and_drives_below_half_the_distance() -> None:
    drive = BeaconDrive(scene(4))
    start_m = drive.trajectory(0.0, 1.0).p_enu_m[0]
    assert np.linalg.norm(start_m) == pytest.approx(15.0)
    drive.watch(10.0, 7.6)
    assert drive.velocity(20.0) == (0.0, 0.0, 0.0)
    drive.watch(20.0, 7.4)
    drive.watch(25.0, 7.0)
    path = drive.trajectory(19.0, 40.0)
    assert path.p_enu_m[0].tolist() == start_m.tolist()
    assert np.linalg.norm(path.p_enu_m[-1] - start_m) == pytest.approx(0.1 * 20 - 0.025)
    assert math.hypot(*drive.velocity(30.0)) == pytest.approx(0.1)
    steps_m_s = np.linalg.norm(np.diff(path.p_enu_m, axis=0), axis=1) / np.diff(path.t_s)
    assert steps_m_s.max() < 0.1001
    assert math.atan2(*drive.velocity(30.0)[1::-1]) == pytest.approx(drive.yaw_rad)


def test_the_place_is_that_of_the_trajectory_before_the_drive_and_on_it() -> None:
    drive = BeaconDrive(scene(4))
    stands = drive.place(3.0)
    assert stands == tuple(drive.trajectory(3.0, 3.0).p_enu_m[0].tolist()) == drive.place(0.0)
    drive.watch(3.0, 0.0)
    assert drive.place(9.0) == tuple(drive.trajectory(9.0, 9.0).p_enu_m[0].tolist()) != stands


def test_seeds_place_the_beacon_differently() -> None:
    starts = {tuple(BeaconDrive(scene(seed)).trajectory(0.0, 1.0).p_enu_m[0].tolist()) for seed in (1, 1, 2, 3)}
    assert len(starts) == 3


def test_a_vehicle_track_is_cut_around_the_slot_and_unwraps_yaw() -> None:
    track = VehicleTrack()
    for k in range(100):
        track.append(k * 0.01, (k * 0.1, 0.0, 0.0), math.remainder(3.0 + k * 0.01, math.tau))
    track.append(0.5, (99.0, 0.0, 0.0), 0.0)  # late, ignored
    cut = track.trajectory(0.305, 0.322)
    assert cut.t_s.tolist() == pytest.approx([0.30, 0.31, 0.32, 0.33])
    p_enu_m, yaw_rad = cut.at(np.array([0.315]))
    assert p_enu_m[0, 0] == pytest.approx(3.15)
    assert yaw_rad[0] == pytest.approx(3.315)
    assert track.newest_s == pytest.approx(0.99)
    assert track.trajectory(2.0, 2.1).at(np.array([2.05]))[0][0, 0] == pytest.approx(9.9)


def _round(speed_m_s: float, straight_m: float, radius_m: float) -> BeaconDrive:
    course = replace(scene(4), beacon_azimuth_rad=0.0, drive_azimuth_rad=math.pi / 2, drive_speed_m_s=speed_m_s)
    return BeaconDrive(replace(course, drive_after_m=0.5, drive_straight_m=straight_m, drive_turn_radius_m=radius_m))


def test_a_closed_course_begins_with_the_flight_and_leads_back() -> None:
    drive = _round(0.3, 6.0, 2.0)
    drive.watch(1.0, 15.0, 0.4)
    assert drive.velocity(30.0) == (0.0, 0.0, 0.0)
    drive.watch(2.0, 15.0, 0.6)
    ramp_s = 0.3 / 0.2
    straight_on_s = 2.0 + ramp_s / 2 + 6.0 / 0.3
    half_circle_s = math.pi * 2.0 / 0.3
    times_s = np.array([straight_on_s, straight_on_s + half_circle_s / 2, straight_on_s + half_circle_s])
    path = drive.trajectory(0.0, straight_on_s + 2 * half_circle_s + 6.0 / 0.3)
    places_m, yaw_rad = path.at(times_s)
    # North from (15, 0), then round to the left.
    assert places_m == pytest.approx(np.array([[15.0, 6.0, 0.0], [13.0, 8.0, 0.0], [11.0, 6.0, 0.0]]), abs=1e-3)
    assert yaw_rad == pytest.approx(np.array([0.5, 1.0, 1.5]) * math.pi, abs=1e-3)
    assert path.p_enu_m[-1] == pytest.approx([15.0, 0.0, 0.0], abs=1e-3)
    assert drive.velocity(float(times_s[1])) == pytest.approx((-0.3, 0.0, 0.0), abs=1e-6)
    steps_m_s = np.linalg.norm(np.diff(path.p_enu_m, axis=0), axis=1) / np.diff(path.t_s)
    assert steps_m_s.max() < 0.3001


def test_a_closed_course_stays_within_its_corners() -> None:
    drive = _round(1.0, 4.0, 1.5)
    drive.watch(0.0, 15.0, 1.0)
    path_m = drive.trajectory(0.0, 60.0).p_enu_m
    corners_m = drive.places_m()
    assert path_m.min(axis=0) == pytest.approx(corners_m.min(axis=0), abs=0.01)
    assert path_m.max(axis=0) == pytest.approx(corners_m.max(axis=0), abs=0.01)
    assert _round(0.0, 4.0, 1.5).places_m() == pytest.approx(np.array([[15.0, 0.0, 0.0]]))
