"""The path as it is commanded: to the target and around it, searching, without a step; and what stands beside it."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from companion.config.schema import MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3
from companion.guidance.approach import Approach, as_velocity, inside
from companion.guidance.choice import PLACES
from companion.guidance.steering import Aim, kept_inside
from companion.guidance.target import Scatter
from companion.safety.gate import GateLimits

LIMITS = GateLimits(fence_min_m=(-50, -50, -1), fence_max_m=(50, 50, 10), fence_radius_m=60.0, max_speed_m_s=1.0, max_climb_m_s=0.7, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
_TICK_NS = NS_PER_S // 20


@pytest.mark.parametrize(("yaw", "ends_at"), [("fixed", 0.3), ("target", 1.8)])
def test_the_nose_is_kept_or_turned_slowly_to_the_target(yaw: Literal["fixed", "target"], ends_at: float) -> None:
    approach = Approach(MissionConfig(yaw=yaw), LIMITS, 1.2)
    approach.start((0.0, 0.0, 1.5), 0.3)
    yaws = []
    for tick in range(100):
        setpoint = approach.setpoint(
            tick * _TICK_NS, Aim(azimuth_rad=1.8, distance_m=20.0, distance_std_m=1.0, sureness=1.0), True
        )
        assert setpoint.yaw_enu_rad is not None
        yaws.append(setpoint.yaw_enu_rad)
    assert yaws[0] == pytest.approx(0.3) and yaws[-1] == pytest.approx(ends_at)
    assert max(abs(b - a) for a, b in itertools.pairwise(yaws)) <= math.radians(30) / 20 + 1e-9


def _flown(
    approach: Approach, target_m: Vector3, ticks: int, known: bool = True, place: Vector3 = (0.0, 0.0, 1.5)
) -> list[Setpoint]:
    """Set points of a vehicle that follows exactly, towards a target that it knows where to find."""
    flown: list[Setpoint] = []
    for tick in range(ticks):
        east, north = target_m[0] - place[0], target_m[1] - place[1]
        aim = (
            Aim(
                azimuth_rad=math.atan2(north, east),
                distance_m=math.hypot(east, north),
                distance_std_m=0.3,
                sureness=1.0,
                above_m=target_m[2] - place[2],
            )
            if known
            else None
        )
        flown.append(approach.setpoint(tick * _TICK_NS, aim, True))
        assert flown[-1].p_local_enu_m is not None
        place = flown[-1].p_local_enu_m
    return flown


def test_it_flies_to_the_target_without_a_stop_and_stays_around_it() -> None:
    approach = Approach(MissionConfig(), LIMITS, 1.2)
    approach.start((0.0, 0.0, 1.5), 0.0)
    flown = _flown(approach, (10.0, 4.0, 1.5), 1200)
    away = [math.hypot(10.0 - s.p_local_enu_m[0], 4.0 - s.p_local_enu_m[1]) for s in flown if s.p_local_enu_m]
    near = next(tick for tick, m in enumerate(away) if m < 2.0)
    assert near / 20 < 1.2 * (math.hypot(10, 4) - 2) / 0.5
    assert all(1.0 < m < 1.9 for m in away[near + 60 :])
    speeds = [math.hypot(*s.v_local_enu_m_s) for s in flown]
    assert min(speeds[20:]) > 0.25 and max(speeds) < 0.65
    heights = [s.p_local_enu_m[2] for s in flown if s.p_local_enu_m]
    assert all(1.2 < h < 1.8 for h in heights)


@pytest.mark.parametrize(("takeoff_m", "target_up_m"), [(3.0, 0.2), (1.5, -0.3), (1.5, 3.5), (1.5, 0.5)])
def test_from_near_it_leaves_its_height_for_one_from_which_it_can_arrive(takeoff_m: float, target_up_m: float) -> None:
    approach = Approach(MissionConfig(takeoff_height_m=takeoff_m), LIMITS, 1.2)
    approach.start((0.0, 0.0, takeoff_m), 0.0)
    target_m = (10.0, 4.0, target_up_m)
    flown = _flown(approach, target_m, 1200, place=(0.0, 0.0, takeoff_m))
    places_m = np.array([s.p_local_enu_m for s in flown])
    apart_m = np.linalg.norm(places_m - target_m, axis=1)
    assert apart_m[-200:].max() < 1.85 and apart_m.min() > LIMITS.min_neighbour_m + 0.1
    afar = np.hypot(*(places_m - target_m)[:, :2].T) > 4.0
    assert np.abs(places_m[afar, 2] - takeoff_m).max() < 0.3
    kept_m = places_m[-200:, 2] - takeoff_m
    assert np.abs(kept_m).max() < 0.3 or abs(target_up_m - takeoff_m) > 1.3


@pytest.mark.parametrize("ground_m", [0.0, 2.0, -3.0])
def test_it_comes_down_no_farther_than_the_least_height_and_climbs_again_to_search(ground_m: float) -> None:
    approach = Approach(MissionConfig(), replace(LIMITS, fence_min_m=(-50, -50, -9)), 1.2)
    start_m = (0.0, 0.0, ground_m + 1.5)
    approach.start(start_m, 0.0, ground_m)
    flown = _flown(approach, (3.0, 0.0, ground_m - 2.0), 1200, place=start_m)
    heights_m = np.array([s.p_local_enu_m for s in flown])[:, 2] - ground_m
    assert heights_m.min() > LIMITS.min_height_m + 0.1 and heights_m[-1] < 1.3
    found = [approach.setpoint((1200 + k) * _TICK_NS, None, True).p_local_enu_m for k in range(200)]
    assert found[-1] is not None
    assert found[-1][2] - ground_m == pytest.approx(1.5, abs=0.2)


def test_a_low_flight_is_not_lifted_to_come_down() -> None:
    mission = MissionConfig(takeoff_height_m=0.65)
    approach = Approach(mission, LIMITS, 1.2)
    approach.start((0.0, 0.0, 0.65), 0.0)
    low = np.array([s.p_local_enu_m for s in _flown(approach, (5.0, 0.0, -1.0), 600, place=(0.0, 0.0, 0.65))])[:, 2]
    assert low.max() < 1.2


def _scatter(rng: np.random.Generator, places_m: np.ndarray) -> Scatter:
    heading, elevation = rng.normal(0.0, 0.03, (2, PLACES))
    return Scatter(places_m, heading, elevation, np.array([0.9, 0.08, 0.02]))


@pytest.mark.parametrize(("ratio", "goes_beside"), [(0.02, False), (0.5, True)])
def test_it_flies_beside_a_near_place_whose_range_is_vague(ratio: float, goes_beside: bool) -> None:
    rng, approach = np.random.default_rng(1), Approach(MissionConfig(), LIMITS, 1.2)
    approach.start((0.0, 0.0, 1.5), 0.0)
    range_m = 4.0 * np.exp(rng.normal(0.0, ratio, PLACES))
    places_m = np.stack([range_m, np.zeros(PLACES), rng.normal(0.5, 0.2, PLACES)], axis=1)
    scatter = _scatter(rng, places_m)
    flown = [
        approach.setpoint(
            k * _TICK_NS,
            Aim(
                azimuth_rad=0.0, distance_m=4.0, distance_std_m=ratio * 4.0, sureness=1.0, above_m=-1.0, scatter=scatter
            ),
            True,
        )
        for k in range(90)
    ]
    beside_m = [abs(s.p_local_enu_m[1]) for s in flown if s.p_local_enu_m]
    assert (beside_m[-1] > 0.25) == goes_beside


@pytest.mark.parametrize("seed", range(6))
def test_after_a_leg_that_was_given_up_it_goes_by_the_other_side(seed: int) -> None:
    rng, approach = np.random.default_rng(seed), Approach(MissionConfig(), LIMITS, 1.2)
    range_m = 4.0 * np.exp(rng.normal(0.0, 0.6, PLACES))
    scatter = _scatter(rng, np.stack([range_m, np.zeros(PLACES), rng.normal(0.5, 0.2, PLACES)], axis=1))
    aim = Aim(azimuth_rad=0.0, distance_m=4.0, distance_std_m=2.4, sureness=1.0, above_m=-1.0, scatter=scatter)
    sides = []
    for leg in range(3):
        approach.start((0.0, 0.0, 1.5), 0.0)
        flown = [approach.setpoint((1000 * leg + k) * _TICK_NS, aim, True).p_local_enu_m for k in range(90)]
        assert flown[-1] is not None
        assert abs(flown[-1][1]) > 0.25
        sides.append(math.copysign(1.0, flown[-1][1]))
    assert sides[0] == -sides[1] == sides[2]


def test_a_search_goes_all_around_and_wider_inside_the_fence() -> None:
    narrow = replace(LIMITS, fence_min_m=(-3, -3, -1), fence_max_m=(3, 3, 5))
    approach = Approach(MissionConfig(), narrow, 1.2)
    approach.start((0.0, 0.0, 1.5), 0.7)
    flown = [s.p_local_enu_m for s in _flown(approach, (0.0, 0.0, 0.0), 2400, known=False) if s.p_local_enu_m]
    assert all(abs(x) < 3 and abs(y) < 3 for x, y, _ in flown)
    first, last = (np.ptp(np.array(part), axis=0) for part in (flown[:160], flown[-600:]))
    assert min(first[:2]) > 0.5 and min(last[:2]) > 1.5 * min(first[:2])


def test_neither_a_new_aim_nor_a_late_tick_nor_a_stop_makes_a_step() -> None:
    rng, approach = np.random.default_rng(3), Approach(MissionConfig(), LIMITS, 1.2)
    approach.start((0.0, 0.0, 1.5), 0.0, v_local_enu_m_s=(0.3, -0.2, 0.0))
    now_ns, flown = 0, list[tuple[float, Setpoint]]()
    aim: Aim | None = None
    for _ in range(1500):
        if rng.random() < 0.05:
            places = _scatter(rng, rng.uniform(-9, 9, (PLACES, 3)))
            aim = Aim(
                azimuth_rad=float(rng.uniform(-3, 3)),
                distance_m=float(rng.uniform(0, 9)),
                distance_std_m=float(rng.uniform(0, 9)),
                sureness=0.5,
                above_m=0.0,
                scatter=places,
            )
        late_ns = int(rng.choice([0, 0, 0, _TICK_NS]))
        now_ns += _TICK_NS + late_ns
        flown.append((now_ns / NS_PER_S, approach.setpoint(now_ns, aim, bool(rng.random() < 0.97))))
    t_s, v = np.array([t for t, _ in flown]), np.array([s.v_local_enu_m_s for _, s in flown])
    p = np.array([s.p_local_enu_m for _, s in flown])
    steps_s = np.diff(t_s)
    acceleration = np.diff(v, axis=0) / np.minimum(steps_s, 0.1)[:, None]
    assert np.linalg.norm(acceleration, axis=1).max() < 0.81
    assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() < 0.9  # over up to 0.1 s; 0.5 in one tick
    agreed = np.diff(p, axis=0) / np.minimum(steps_s, 0.1)[:, None] - v[1:]
    assert np.linalg.norm(agreed, axis=1).max() < 0.08


def test_a_frame_that_was_set_anew_takes_the_path_along() -> None:
    approach = Approach(MissionConfig(), LIMITS, 1.2)
    approach.start((1.0, 2.0, 1.5), 0.0)
    before = approach.setpoint(0, None, False)
    approach.shift((5.0, 0.0, 0.25))
    after = approach.setpoint(0, None, False)
    assert before.p_local_enu_m == (1.0, 2.0, 1.5) and after.p_local_enu_m == (6.0, 2.0, 1.75)


def test_a_velocity_leads_back_to_the_path_within_the_limits() -> None:
    limits = GateLimits(fence_min_m=(-9, -9, -1), fence_max_m=(9, 9, 9), fence_radius_m=9.0, max_speed_m_s=1.0, max_climb_m_s=0.5, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
    path = Setpoint(7, (1.0, 2.0, 1.5), (0.5, 0.0, 0.0), 0.3)
    assert as_velocity(path, (1.0, 2.0, 1.5), limits) == Setpoint(7, None, (0.5, 0.0, 0.0), 0.3)
    back = as_velocity(path, (1.0, 2.5, 1.4), limits)
    assert back.v_local_enu_m_s == pytest.approx((0.5, -0.4, 0.08))
    far = as_velocity(path, (1.0, -50.0, 30.0), limits)
    assert math.hypot(*far.v_local_enu_m_s[:2]) == pytest.approx(1.0) and far.v_local_enu_m_s[2] == -0.5


def test_after_a_refusal_it_stands_inside_the_fence() -> None:
    limits = GateLimits(fence_min_m=(-9, -4, -1), fence_max_m=(9, 4, 5), fence_radius_m=6.0, max_speed_m_s=1.0, max_climb_m_s=0.5, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
    assert inside((1.0, 2.0, 1.5), limits, 0.0) == pytest.approx((1.0, 2.0, 1.5))
    assert inside((0.0, 5.0, 1.5), limits, 0.0) == pytest.approx((0.0, 3.7, 1.5))
    assert inside((7.0, 0.0, 1.5), limits, 0.0) == pytest.approx((5.7, 0.0, 1.5))
    assert inside((0.0, 0.0, 9.0), limits, 0.0)[2] == pytest.approx(4.7)
    assert inside((0.0, 0.0, 0.1), limits, 0.0)[2] == pytest.approx(0.8)
    assert inside((0.0, 0.0, 1.6), limits, 1.0)[2] == pytest.approx(1.8)
    turned = replace(limits, fence_yaw_deg=90.0)  # nine metres to the North now, and four to the East
    assert inside((5.0, 0.0, 1.5), turned, 0.0) == pytest.approx((3.7, 0.0, 1.5))
    assert kept_inside((0.5, 0.0, 0.0), (4.5, 0.0, 1.5), turned, 0.0)[0] < 0.0
    assert kept_inside((0.0, 0.5, 0.0), (0.0, 4.5, 1.5), turned, 0.0) == pytest.approx((0.0, 0.45, 0.0), abs=0.06)
    narrow = replace(limits, fence_min_m=(-0.1, -4, -1), fence_max_m=(0.1, 4, 5))
    assert inside((3.0, 1.0, 1.5), narrow, 0.0) == pytest.approx((0.0, 1.0, 1.5))
