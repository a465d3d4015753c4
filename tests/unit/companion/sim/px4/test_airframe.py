"""A point with limits: it follows what is demanded within them, and gusts are the same for the same seed."""

from __future__ import annotations

import itertools
import math

import pytest

from companion.core.messages import Vector3
from companion.sim.px4.airframe import Airframe, AirframeLimits, Demand, Gusts

_FREE: tuple[None, None, None] = (None, None, None)
_DT_S = 0.01


def _flown(demand: Demand, seconds: float, start_m: Vector3 = (0.0, 0.0, 5.0), gusts: Gusts | None = None) -> Airframe:
    airframe = Airframe(AirframeLimits(), 0.0, gusts)
    airframe.p_enu_m = start_m
    for _ in range(round(seconds / _DT_S)):
        airframe.step(demand, _DT_S)
    return airframe


def test_a_velocity_is_reached_and_a_place_is_held() -> None:
    assert _flown(Demand(_FREE, (1.0, -0.5, 0.2)), 5.0).v_enu_m_s == pytest.approx((1.0, -0.5, 0.2), abs=0.01)
    assert _flown(Demand((3.0, -2.0, 4.0), (0.0, 0.0, 0.0)), 12.0).p_enu_m == pytest.approx((3.0, -2.0, 4.0), abs=0.01)


@pytest.mark.parametrize(
    ("wanted", "reached"),
    [((9.0, 0.0, 0.0), (5.0, 0.0, 0.0)), ((0.0, 0.0, 9.0), (0.0, 0.0, 3.0)), ((0.0, 0.0, -9.0), (0.0, 0.0, -1.5))],
)
def test_nothing_flies_faster_than_its_limits(wanted: Vector3, reached: Vector3) -> None:
    assert _flown(Demand(_FREE, wanted), 6.0, (0.0, 0.0, 50.0)).v_enu_m_s == pytest.approx(reached, abs=0.01)


def test_no_step_is_harder_than_the_acceleration_it_has() -> None:
    airframe, speeds = Airframe(AirframeLimits(), 0.0, None), [0.0]
    airframe.p_enu_m = (0.0, 0.0, 5.0)
    for _ in range(300):
        airframe.step(Demand(_FREE, (5.0, 0.0, 0.0)), _DT_S)
        speeds.append(airframe.v_enu_m_s[0])
    assert max(b - a for a, b in itertools.pairwise(speeds)) <= 3.0 * _DT_S + 1e-9


def test_it_lands_on_the_ground_and_goes_no_deeper() -> None:
    airframe = _flown(Demand(_FREE, (0.0, 0.0, -1.0)), 8.0, (1.0, 2.0, 3.0))
    assert airframe.on_ground
    assert airframe.p_enu_m == (1.0, 2.0, 0.0)
    assert airframe.v_enu_m_s == (0.0, 0.0, 0.0)


def test_the_nose_turns_the_short_way_no_faster_than_it_can() -> None:
    airframe = _flown(Demand(_FREE, (0.0, 0.0, 0.0), yaw_enu_rad=math.radians(-170.0)), 0.5)
    assert airframe.yaw_enu_rad == pytest.approx(math.radians(-30.0))
    airframe.yaw_enu_rad = math.radians(170.0)
    airframe.step(Demand(_FREE, (0.0, 0.0, 0.0), yaw_enu_rad=math.radians(-170.0)), 0.1)
    assert airframe.yaw_enu_rad == pytest.approx(math.radians(176.0))


def test_what_the_estimator_believes_is_what_is_flown_by() -> None:
    airframe = Airframe(AirframeLimits(), 0.0, None)
    airframe.p_enu_m, airframe.estimate_offset_enu_m = (0.0, 0.0, 5.0), (1.0, 0.0, 0.0)
    for _ in range(1200):
        airframe.step(Demand((3.0, 0.0, 5.0), (0.0, 0.0, 0.0)), _DT_S)
    assert airframe.p_enu_m == pytest.approx((2.0, 0.0, 5.0), abs=0.01)
    assert airframe.estimated_p_enu_m == pytest.approx((3.0, 0.0, 5.0), abs=0.01)
    airframe.v_enu_m_s = (2.0, 0.0, 0.0)
    assert airframe.stopping_point_enu_m() == pytest.approx((3.0 + 4.0 / 6.0, 0.0, 5.0), abs=0.01)


def test_gusts_are_those_of_their_seed_and_as_strong_as_they_say() -> None:
    def drawn(seed: int) -> list[float]:
        gusts = Gusts(seed, gust_m_s2=0.25)
        found = []
        for _ in range(20_000):
            gusts.step(0.1)
            found.append(gusts.acceleration_enu_m_s2[0])
        return found

    first = drawn(1)
    assert first == drawn(1)
    assert first != drawn(2)
    assert math.sqrt(sum(a * a for a in first) / len(first)) == pytest.approx(0.25, rel=0.1)
