"""Velocities for where the vehicle is: to a target and around it, in a search, inside the fence."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.guidance.steering import Aim, climb, kept_inside, search, towards
from companion.safety.gate import GateLimits

LIMITS = GateLimits(
    fence_min_m=(-10, -10, -1), fence_max_m=(10, 10, 5), fence_radius_m=8.0, max_speed_m_s=1.0, max_climb_m_s=0.7,
    max_acceleration_m_s2=3.0, min_height_m=0.5,
)  # fmt: skip


def test_a_place_that_is_known_is_flown_at_straight() -> None:
    assert towards(
        Aim(azimuth_rad=0.0, distance_m=20.0, distance_std_m=0.0, sureness=1.0), 0.5, 1.5, 1
    ) == pytest.approx((0.5, 0.0))
    assert towards(
        Aim(azimuth_rad=math.pi / 2, distance_m=20.0, distance_std_m=0.0, sureness=1.0), 0.5, 1.5, 1
    ) == pytest.approx((0.0, 0.5))


def test_on_its_circle_it_flies_around_and_inside_of_it_outwards() -> None:
    on = towards(Aim(azimuth_rad=0.0, distance_m=1.5, distance_std_m=0.0, sureness=1.0), 0.5, 1.5, 1)
    assert on == pytest.approx((0.0, 0.5)), "a target to the East is kept to the right by flying North"
    assert towards(
        Aim(azimuth_rad=0.0, distance_m=1.5, distance_std_m=0.0, sureness=1.0), 0.5, 1.5, -1
    ) == pytest.approx((0.0, -0.5))
    assert towards(Aim(azimuth_rad=0.0, distance_m=1.2, distance_std_m=0.0, sureness=1.0), 0.5, 1.5, 1)[0] < 0.0


@pytest.mark.parametrize("distance_m", [3.0, 20.0, math.inf])
def test_the_vaguer_the_range_the_more_it_flies_beside_the_target_at_the_same_speed(distance_m: float) -> None:
    sides = []
    for ratio in (0.0, 0.2, 0.6):
        spread = math.inf if math.isinf(distance_m) else ratio * distance_m
        east, north = towards(
            Aim(azimuth_rad=0.0, distance_m=distance_m, distance_std_m=spread, sureness=0.5), 0.5, 1.5, 1
        )
        assert math.hypot(east, north) == pytest.approx(0.5)
        sides.append(math.atan2(north, east))
    assert sides == sorted(sides)
    assert math.degrees(sides[-1]) == pytest.approx(28.0 if distance_m == 3.0 else 10.0, abs=0.1)


@pytest.mark.parametrize(("chosen_deg", "flown_deg"), [(45.0, 45.0), (0.0, 10.0)])
def test_a_lead_is_as_chosen_but_no_less_than_the_range_is_vague(chosen_deg: float, flown_deg: float) -> None:
    aim = Aim(azimuth_rad=0.0, distance_m=20.0, distance_std_m=10.0, sureness=0.5)
    east, north = towards(aim, 0.5, 1.5, 1, lead_rad=math.radians(chosen_deg))
    assert math.degrees(math.atan2(north, east)) == pytest.approx(flown_deg)


def test_a_search_begins_along_the_nose_and_turns_wider_and_wider() -> None:
    assert search(0.0, 0.3, 0.5) == pytest.approx((0.5 * math.cos(0.3), 0.5 * math.sin(0.3)))
    turned = [math.atan2(*reversed(search(m, 0.0, 0.5))) for m in (0.5, 1.0)]
    later = [math.atan2(*reversed(search(30.0 + m, 0.0, 0.5))) for m in (0.0, 0.5)]
    assert turned[1] - turned[0] > math.remainder(later[1] - later[0], math.tau) > 0.0


def test_it_climbs_to_its_height_no_faster_than_it_may() -> None:
    assert climb(1.0, 1.5, 0.7) == pytest.approx(0.25)
    assert climb(0.0, 9.0, 0.7) == 0.7
    assert climb(9.0, 0.0, 0.7) == -0.7


def test_far_from_all_limits_a_velocity_stays_as_it_is() -> None:
    assert kept_inside((0.5, -0.3, 0.1), (1.0, 2.0, 1.5), LIMITS, 0.0) == pytest.approx((0.5, -0.3, 0.1))


@pytest.mark.parametrize(
    ("p_m", "v_m_s", "axis", "sign"),
    [
        ((0.0, 0.0, 4.9), (0.0, 0.0, 0.5), 2, -1),
        ((0.0, 0.0, 0.6), (0.0, 0.0, -0.5), 2, 1),
        ((7.9, 0.0, 1.5), (1.0, 0.0, 0.0), 0, -1),
        ((0.0, -7.9, 1.5), (0.0, -1.0, 0.0), 1, 1),
    ],
)
def test_beside_a_limit_the_velocity_leads_back(
    p_m: tuple[float, float, float], v_m_s: tuple[float, float, float], axis: int, sign: int
) -> None:
    assert sign * kept_inside(v_m_s, p_m, LIMITS, 0.0)[axis] > 0.0


def test_along_the_fence_it_may_fly_and_on_the_ground_it_stays_level() -> None:
    _, along, _ = kept_inside((1.0, 0.5, 0.0), (7.9, 0.0, 1.5), LIMITS, 0.0)
    assert along == pytest.approx(0.5)
    assert kept_inside((0.3, 0.0, 0.4), (0.0, 0.0, 0.1), replace(LIMITS, on_ground=True), 0.0) == (0.3, 0.0, 0.0)
