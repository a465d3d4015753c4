"""The mock's rover: what its source says of PX4's."""

from __future__ import annotations

import math

import pytest

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.sim.px4.airframe import Demand
from companion.sim.px4.autopilot import Px4
from companion.sim.px4.commander import Mode, Result
from companion.sim.px4.rover import RoverFrame

_NOWHERE = (None, None, None)


def _driven(demand: Demand, seconds: float, yaw_rad: float = 0.0) -> RoverFrame:
    rover = RoverFrame(yaw_rad, None)
    for _ in range(round(seconds / 0.01)):
        rover.step(demand, 0.01)
    return rover


def test_it_drives_where_it_looks() -> None:
    rover = _driven(Demand(_NOWHERE, (0.4, 0.0, 0.3)), 5.0)
    assert rover.p_enu_m == pytest.approx((2.0, 0.0, 0.0), abs=0.1)
    assert rover.v_enu_m_s == pytest.approx((0.4, 0.0, 0.0), abs=1e-6)


def test_it_turns_on_the_spot_before_it_drives_back() -> None:
    back = Demand(_NOWHERE, (-0.4, 0.05, 0.0))
    early = _driven(back, 1.0)
    assert math.hypot(*early.p_enu_m) < 0.01 and early.yaw_enu_rad > math.radians(60)
    assert _driven(back, 8.0).p_enu_m[0] < -1.5


def test_a_velocity_of_nothing_points_north_and_a_place_near_by_does_not() -> None:
    assert _driven(Demand(_NOWHERE, (0.0, 0.0, 0.0)), 4.0).yaw_enu_rad == pytest.approx(math.pi / 2, abs=0.05)
    near: tuple[float | None, float | None, float | None] = (0.2, -0.2, 0.0)
    stands = _driven(Demand(near, (0.0, 0.0, 0.0)), 4.0)
    assert stands.yaw_enu_rad == 0.0 and stands.p_enu_m == (0.0, 0.0, 0.0)
    assert math.dist(_driven(Demand((3.0, 2.0, None), (0.0, 0.0, 0.0)), 20.0).p_enu_m, (3.0, 2.0, 0.0)) < 0.6


class _Rover:
    def __init__(self) -> None:
        self.now_ns = 10 * NS_PER_S
        self.px4 = Px4(self.now_ns, vehicle="rover", parameters={"COM_OBL_RC_ACT": 5})
        self.commander = self.px4.commander
        self.run(0.1)

    def run(self, seconds: float, v_m_s: Vector3 | None = None) -> None:
        for _ in range(round(seconds / 0.02)):
            self.now_ns += NS_PER_S // 50
            if v_m_s is not None:
                self.commander.set_point(Demand(_NOWHERE, v_m_s), self.now_ns)
            self.px4.step(self.now_ns)


def test_armed_it_has_not_landed_until_it_is_told_to() -> None:
    rover = _Rover()
    assert rover.commander.landed and rover.commander.command_takeoff() is Result.ACCEPTED
    assert rover.commander.arm(rover.now_ns) is Result.TEMPORARILY_REJECTED, "it has no takeoff"
    rover.commander.command_mode(Mode.HOLD, rover.now_ns)
    assert rover.commander.arm(rover.now_ns) is Result.ACCEPTED
    rover.run(30.0)
    assert rover.commander.armed and not rover.commander.landed
    rover.run(1.0, (0.4, 0.0, 0.0))
    assert rover.commander.command_mode(Mode.OFFBOARD, rover.now_ns) is Result.ACCEPTED
    rover.run(5.0, (0.4, 0.0, 0.0))
    away_m = rover.commander.airframe.p_enu_m[0]
    assert away_m == pytest.approx(2.0, abs=0.2)
    rover.run(3.0)
    assert rover.commander.mode is Mode.HOLD and rover.commander.failsafe, "the stream is lost"
    rover.commander.command_mode(Mode.LAND, rover.now_ns)
    rover.run(3.0)
    assert not rover.commander.armed and rover.commander.landed
    assert rover.commander.airframe.p_enu_m[0] == pytest.approx(away_m + 0.5, abs=0.5)


def test_it_returns_along_the_ground_and_has_landed_at_home() -> None:
    rover = _Rover()
    rover.commander.arm(rover.now_ns)
    rover.run(1.0, (0.6, 0.0, 0.0))
    rover.commander.command_mode(Mode.OFFBOARD, rover.now_ns)
    rover.run(10.0, (0.6, 0.0, 0.0))
    rover.commander.command_mode(Mode.RTL, rover.now_ns)
    rover.run(30.0)
    assert not rover.commander.armed and math.hypot(*rover.commander.airframe.p_enu_m) < 2.0
