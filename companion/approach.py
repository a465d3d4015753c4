"""The path under the set points: a leg, a pause until its bearing is there, the next leg."""

from __future__ import annotations

from enum import Enum, auto

from companion.clock import NS_PER_S
from companion.config import MissionConfig
from companion.guidance import LegShape, plan_leg
from companion.messages import Setpoint, Vector3
from companion.sar import SarIterations


class _Phase(Enum):
    REST = auto()
    LEG = auto()
    SETTLE = auto()
    """At rest after a leg while late reverse channels still arrive."""
    WAIT = auto()
    """At rest while the worker computes."""


class Approach:
    """Makes one set point for each tick. The position it commands never jumps: each leg starts where the last ended."""

    def __init__(self, sar: SarIterations, mission: MissionConfig, length_m: float, settle_s: float) -> None:
        self._sar = sar
        self._height_m = mission.takeoff_height_m
        self._settle_ns = round(settle_s * NS_PER_S)
        self._shape = LegShape(
            length_m, mission.lateral_weave_m, mission.vertical_weave_m, mission.speed_m_s, mission.acceleration_m_s2
        )
        self._phase = _Phase.REST
        self._phase_ns = 0
        self._side = 1
        self._yaw_rad = 0.0
        self._at_m: Vector3 = (0.0, 0.0, 0.0)

    def start(self, p_local_enu_m: Vector3, yaw_enu_rad: float) -> None:
        """Begin from where the vehicle is, with the heading it has: it is kept, the antenna hears all around."""
        self._at_m, self._yaw_rad = p_local_enu_m, yaw_enu_rad
        self._phase = _Phase.REST

    def setpoint(self, now_ns: int, azimuth_rad: float, moving: bool) -> Setpoint:
        """The set point of this tick. A new leg goes along `azimuth_rad`; without `moving` the vehicle stands."""
        if not moving:
            self._enter(_Phase.REST, now_ns)
            self._sar.start_ns = None
        elif self._phase is _Phase.REST:
            self._leg = plan_leg(self._at_m, azimuth_rad, self._height_m, self._side, self._shape)
            self._side = -self._side
            self._sar.begin()
            self._enter(_Phase.LEG, now_ns)
        velocity: Vector3 = (0.0, 0.0, 0.0)
        elapsed_ns = now_ns - self._phase_ns
        if self._phase is _Phase.LEG:
            self._at_m, velocity = self._leg.at(elapsed_ns / NS_PER_S)
            if elapsed_ns >= self._leg.duration_s * NS_PER_S:
                self._enter(_Phase.SETTLE, now_ns)
        elif self._phase is _Phase.SETTLE and elapsed_ns >= self._settle_ns:
            self._sar.finish(self._phase_ns)
            self._enter(_Phase.WAIT, now_ns)
        elif self._phase is _Phase.WAIT and not self._sar.is_waiting:
            self._enter(_Phase.REST, now_ns)
        return Setpoint(now_ns, self._at_m, velocity, self._yaw_rad)

    def _enter(self, phase: _Phase, now_ns: int) -> None:
        self._phase, self._phase_ns = phase, now_ns
