"""Scenes: what each name promises holds for any seed, and a scene is a function of its seed."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import asdict, replace

import numpy as np
import numpy.typing as npt
import pytest

from companion.config.schema import GateConfig
from companion.errors import ConfigError
from companion.safety.gate import GateLimits
from companion.sim.scenario import Reflector, Scenario, encode_scenario, load_scenario
from companion.sim.scenes import SCENES, fence_in, is_outside, scene_names, set_in
from companion.sim.trajectory import BeaconDrive
from tests.sim_scenes import scene

SEEDS = range(20)


@functools.cache
def _set(name: str, seed: int) -> tuple[Scenario, npt.NDArray[np.float64]]:
    """A scene, and where its beacon is in five minutes, each tenth of a second."""
    scenario = set_in(scene(seed), name)
    drive = BeaconDrive(scenario)
    drive.watch(0.0, 0.0, 99.0)
    return scenario, drive.trajectory(0.0, 300.0).p_enu_m[::10].copy()


def _walls(scenario: Scenario) -> list[Reflector]:
    return [plane for plane in scenario.radio.reflectors if plane.normal[2] == 0]


@pytest.mark.parametrize("name", SCENES)
def test_all_planes_are_beyond_both_robots_and_the_whole_drive(name: str) -> None:
    least_m = 2.0 if name.startswith(("hard", "furniture")) else 6.0
    for seed in SEEDS:
        scenario, course_m = _set(name, seed)
        for wall in _walls(scenario):
            beyond_m = wall.offset_m - np.vstack([np.zeros((1, 3)), course_m]) @ np.array(wall.normal)
            assert beyond_m.min() > least_m - 1e-6, seed
        assert not any(is_outside(scenario.radio, (x, y, 1.0)) for x, y, _ in course_m[::50].tolist()), seed


@pytest.mark.parametrize("name", SCENES)
def test_its_fence_is_within_the_walls_and_around_both_robots(name: str) -> None:
    for seed in SEEDS:
        scenario, course_m = _set(name, seed)
        fence = fence_in(scenario.radio, GateConfig())
        limits = GateLimits(**asdict(fence))
        corners = itertools.product(
            *zip(fence.fence_min_m[:2], fence.fence_max_m[:2], strict=True), (0.5, limits.fence_max_m[2])
        )
        for x, y, z in corners:
            assert not is_outside(scenario.radio, limits.in_enu_axes((x, y, z))), seed
        for x, y, _ in course_m[::50].tolist():
            assert limits.is_in_box((x, y, 0.5)), seed
        assert limits.is_in_box((0.0, 0.0, 1.5)), seed
        walls = len(_walls(scenario))
        assert fence.fence_max_m[2] < 10.0 or not name.startswith(("hard", "furniture")), seed
        drawn_in = sum(abs(edge) < 50.0 for edge in (*fence.fence_min_m[:2], *fence.fence_max_m[:2]))
        assert drawn_in == walls, seed


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_a_function_of_its_seed_and_survives_its_file(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    assert set_in(scene(3), name) == set_in(scene(3), name) != set_in(scene(4), name)
    path = tmp_path_factory.mktemp("scene") / "scenario.json"
    path.write_bytes(encode_scenario(set_in(scene(3), name)))
    assert load_scenario(path) == set_in(scene(3), name)


@pytest.mark.parametrize(("name", "loss_db"), [("hard", 0.0), ("hard-10db", 10.0), ("hard-14db", 14.0)])
def test_hard_rooms_have_strong_walls_and_a_weak_direct_path(name: str, loss_db: float) -> None:
    for seed in SEEDS:
        radio = set_in(scene(seed), name).radio
        floor, *others = radio.reflectors
        assert len(others) == 5
        assert all(0.3 <= plane.gain <= 0.6 for plane in others)
        assert floor.normal == (0.0, 0.0, 1.0)
        ceilings = [plane.offset_m for plane in others if plane.normal[2] == 1.0]
        assert len(ceilings) == 1
        assert 3.5 <= ceilings[0] <= 7.5
        assert -20 * math.log10(radio.direct_gain) == pytest.approx(loss_db)


@pytest.mark.parametrize("name", SCENES)
def test_the_robot_stands_a_little_higher_or_lower_than_the_vehicle_and_the_floor_is_under_both(name: str) -> None:
    steps_m = []
    for seed in range(100):
        scenario = set_in(scene(seed), name)
        steps_m.append(scenario.beacon_floor_m)
        (floor,) = (p for p in scenario.radio.reflectors if p.normal[2] == 1.0 and p.offset_m <= 0.0)
        assert floor.offset_m == min(0.0, scenario.beacon_floor_m)
        drive = BeaconDrive(scenario)
        drive.watch(0.0, 0.0, 99.0)
        assert set(drive.trajectory(0.0, 60.0).p_enu_m[:, 2]) == {scenario.beacon_floor_m}
    assert np.mean(steps_m) == pytest.approx(0.0, abs=0.06)
    assert np.std(steps_m) == pytest.approx(0.2, abs=0.04)


def test_furniture_is_in_the_room_and_not_on_the_robots() -> None:
    for seed in SEEDS:
        scenario = set_in(scene(seed), "furniture")
        radio = scenario.radio
        assert radio.reflection_order == 2
        assert len(radio.scatterers) == 12
        beacon_m = BeaconDrive(scenario).places_m()[0]
        for thing in radio.scatterers:
            assert not is_outside(radio, thing.p_enu_m)
            assert min(math.hypot(*thing.p_enu_m[:2]), math.dist(thing.p_enu_m[:2], beacon_m[:2])) > 1.0


def test_a_walking_robot_leaves_with_the_flight_away_or_across() -> None:
    for seed in SEEDS:
        scenario = set_in(scene(seed), "moving-0.3")
        drive = BeaconDrive(scenario)
        start_m = drive.trajectory(0.0, 1.0).p_enu_m[0]
        drive.watch(0.0, 15.0, 0.6)
        after_m = drive.trajectory(0.0, 11.0).p_enu_m[-1]
        assert np.linalg.norm(after_m - start_m) == pytest.approx(3.0, abs=0.3)
        assert np.linalg.norm(after_m) > 15.0 - 1e-6
    slow = BeaconDrive(set_in(scene(1), "moving-0.1"))
    slow.watch(0.0, 14.0, 5.0)
    assert slow.velocity(50.0) == (0.0, 0.0, 0.0)


def test_other_scenes_differ_from_the_hall_in_what_they_are_named_for() -> None:
    hall, far, drift, north, bare = (set_in(scene(5), name) for name in ("hall", "far", "drift", "north", "open"))
    assert (hall.start_distance_m, far.start_distance_m) == (15.0, 30.0)
    assert len(_walls(hall)) == 2
    assert all(0.1 <= plane.gain <= 0.3 for plane in hall.radio.reflectors)
    assert len(bare.radio.reflectors) == 1
    assert drift.vio.bias_std == 0.07
    assert abs(math.degrees(north.uav.frame_yaw_rad - hall.uav.frame_yaw_rad)) == pytest.approx(10.0)
    assert north.beacon == hall.beacon
    turns = {np.sign(set_in(scene(seed), "north").uav.frame_yaw_rad) for seed in SEEDS}
    assert turns == {-1.0, 1.0}


def test_where_the_robots_are_may_be_given() -> None:
    given = replace(scene(2), beacon_azimuth_rad=1.0, drive_azimuth_rad=0.5)
    placed = set_in(given, "hard")
    assert (placed.beacon_azimuth_rad, placed.drive_azimuth_rad) == (1.0, 0.5)


def test_how_far_the_robot_is_and_what_is_taken_for_north_may_be_given() -> None:
    """The room is drawn around where the robot then is."""
    hall, other = set_in(scene(2), "hall"), set_in(scene(2), "hall", distance_m=31.0, north_error_rad=0.2)
    assert (hall.start_distance_m, other.start_distance_m) == (15.0, 31.0)
    assert abs(other.uav.frame_yaw_rad - hall.uav.frame_yaw_rad) == pytest.approx(0.2)
    x, y, _ = BeaconDrive(other).place(0.0)
    assert math.hypot(x, y) == pytest.approx(31.0)
    assert not is_outside(other.radio, (x, y, 1.0))
    assert other.beacon_azimuth_rad == hall.beacon_azimuth_rad


def test_an_unknown_scene_is_refused_with_all_there_are() -> None:
    with pytest.raises(ConfigError, match=r"'hell' is unknown; expected one of open, hall, .*occluded"):
        set_in(scene(), "hell")
    assert scene_names(["open", "hard"]) == ("open", "hard")
