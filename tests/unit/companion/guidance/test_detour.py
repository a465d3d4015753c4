"""Who gets no nearer to what is believed looks from elsewhere, inside the fence, and then goes on."""

from __future__ import annotations

import math

import pytest

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.guidance.detour import Detour
from companion.safety.gate import GateLimits

_LIMITS = GateLimits(
    fence_min_m=(-8.0, -6.0, -1.0),
    fence_max_m=(2.0, 6.0, 4.0),
    fence_radius_m=20.0,
    max_speed_m_s=1.0,
    max_climb_m_s=0.7,
    max_acceleration_m_s2=3.0,
    min_height_m=0.3,
)
_BEYOND: Vector3 = (9.0, 0.0, 1.0)
"""Behind the wall in the East."""


def _stay(
    detour: Detour, seconds: float, p_m: Vector3, target_m: Vector3 | None = _BEYOND, from_s: float = 0.0
) -> None:
    for tick in range(round(20 * seconds)):
        wobble_m = 0.4 * math.sin(0.3 * tick)
        now_ns = round((from_s + tick / 20) * NS_PER_S)
        detour.follow(now_ns, (p_m[0], p_m[1] + wobble_m, p_m[2]), target_m)


def test_who_waits_at_the_fence_goes_where_the_target_would_show_itself_from_another_side() -> None:
    detour, at_m = Detour(_LIMITS), (1.2, 1.0, 1.5)
    _stay(detour, 19.0, at_m)
    assert detour.aim(at_m) is None
    _stay(detour, 21.0, at_m)
    aim = detour.aim(at_m)
    assert aim is not None and aim.distance_m > 3.0
    place = (at_m[0] + aim.distance_m * math.cos(aim.azimuth_rad), at_m[1] + aim.distance_m * math.sin(aim.azimuth_rad))
    assert _LIMITS.is_in_box((*place, 1.5))
    assert abs(math.remainder(aim.azimuth_rad, math.tau)) > math.radians(80)


def test_there_it_believes_again_what_it_hears() -> None:
    detour, at_m = Detour(_LIMITS), (1.2, 1.0, 1.5)
    _stay(detour, 21.0, at_m)
    aim = detour.aim(at_m)
    assert aim is not None
    there: Vector3 = (
        at_m[0] + aim.distance_m * math.cos(aim.azimuth_rad), at_m[1] + aim.distance_m * math.sin(aim.azimuth_rad), 1.5,
    )  # fmt: skip
    detour.follow(22 * NS_PER_S, there, _BEYOND)
    assert detour.aim(there) is None


def test_a_place_that_cannot_be_come_to_is_given_up() -> None:
    detour, at_m = Detour(_LIMITS), (1.2, 1.0, 1.5)
    _stay(detour, 21.0, at_m)
    assert detour.aim(at_m) is not None
    _stay(detour, 25.0, at_m, from_s=21.0)
    assert detour.aim(at_m) is None


@pytest.mark.parametrize("target_m", [None, (0.0, 2.0, 0.5)])
def test_who_knows_nothing_or_is_near_stays(target_m: Vector3 | None) -> None:
    detour = Detour(_LIMITS)
    _stay(detour, 60.0, (1.2, 1.0, 1.5), target_m)
    assert detour.aim((1.2, 1.0, 1.5)) is None


def test_who_gets_on_is_left_alone() -> None:
    detour = Detour(_LIMITS)
    for tick in range(1200):
        p_m = (-8.0 + 0.1 * tick / 20, 0.0, 1.5)
        detour.follow(tick * NS_PER_S // 20, p_m, _BEYOND)
        assert detour.aim(p_m) is None


def test_an_interrupted_flight_begins_anew() -> None:
    detour, at_m = Detour(_LIMITS), (1.2, 1.0, 1.5)
    _stay(detour, 15.0, at_m)
    detour.begin_anew()
    _stay(detour, 15.0, at_m, from_s=15.0)
    assert detour.aim(at_m) is None
