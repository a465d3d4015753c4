"""The path under the set points: a leg, a pause until its bearing is there, the next leg."""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import Final

from companion.config.schema import MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3
from companion.guidance.leg import LegShape, plan_leg
from companion.safety.gate import GateLimits
from companion.sensing.iterations import SarIterations

_YAW_RATE_RAD_S: Final = math.radians(30.0)
_LONGEST_TICK_S: Final = 0.2
_FENCE_MARGIN_M: Final = 0.3
_PULL_PER_S: Final = 0.8
"""How much of its distance from the path a vehicle that is led by velocities is led back in a second."""


_NOWHERE: Final[Vector3] = (0.0, 0.0, 0.0)


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
        self._turns = mission.yaw == "target"
        self._yaw_rad = 0.0
        self._tick_ns: int | None = None
        self._at_m: Vector3 = _NOWHERE
        self._moved_m: Vector3 = _NOWHERE
        """By how much the local frame was set anew since the leg was planned."""
        self._ground_m = 0.0

    def start(self, p_local_enu_m: Vector3, yaw_enu_rad: float, ground_m: float = 0.0) -> None:
        """Begin from where the vehicle is, with the heading it has. It is kept, since the antenna hears all around,
        unless the nose is to turn to the target. Heights are counted from `ground_m` (Up), where it stood."""
        self._at_m, self._yaw_rad, self._ground_m = p_local_enu_m, yaw_enu_rad, ground_m
        self._moved_m = _NOWHERE
        self._phase = _Phase.REST
        self._tick_ns = None

    def shift(self, delta_enu_m: Vector3) -> None:
        """The local frame was set anew: all places of it are `delta_enu_m` elsewhere, and nothing has moved."""
        self._at_m = _sum(self._at_m, delta_enu_m)
        self._moved_m = _sum(self._moved_m, delta_enu_m)
        self._ground_m += delta_enu_m[2]

    def setpoint(self, now_ns: int, azimuth_rad: float, moving: bool) -> Setpoint:
        """The set point of this tick. A new leg goes along `azimuth_rad`; without `moving` the vehicle stands."""
        if not moving:
            self._enter(_Phase.REST, now_ns)
            self._sar.abandon()
        elif self._phase is _Phase.REST:
            self._leg = plan_leg(self._at_m, azimuth_rad, self._ground_m + self._height_m, self._side, self._shape)
            self._moved_m = _NOWHERE
            self._side = -self._side
            self._sar.begin()
            self._enter(_Phase.LEG, now_ns)
        velocity: Vector3 = (0.0, 0.0, 0.0)
        elapsed_ns = now_ns - self._phase_ns
        if self._phase is _Phase.LEG:
            at_m, velocity = self._leg.at(elapsed_ns / NS_PER_S)
            self._at_m = _sum(at_m, self._moved_m)
            if elapsed_ns >= self._leg.duration_s * NS_PER_S:
                self._enter(_Phase.SETTLE, now_ns)
        elif self._phase is _Phase.SETTLE and elapsed_ns >= self._settle_ns:
            self._sar.finish(self._phase_ns)
            self._enter(_Phase.WAIT, now_ns)
        elif self._phase is _Phase.WAIT and not self._sar.is_waiting:
            self._enter(_Phase.REST, now_ns)
        if self._turns:
            self._turn(azimuth_rad, now_ns)
        return Setpoint(now_ns, self._at_m, velocity, self._yaw_rad)

    def _turn(self, azimuth_rad: float, now_ns: int) -> None:
        """Nose towards the target, slowly: a fast turn swings the antenna."""
        elapsed_s = 0.0 if self._tick_ns is None else (now_ns - self._tick_ns) / NS_PER_S
        most = _YAW_RATE_RAD_S * min(elapsed_s, _LONGEST_TICK_S)
        error = math.remainder(azimuth_rad - self._yaw_rad, math.tau)
        self._yaw_rad = math.remainder(self._yaw_rad + max(-most, min(most, error)), math.tau)
        self._tick_ns = now_ns

    def _enter(self, phase: _Phase, now_ns: int) -> None:
        self._phase, self._phase_ns = phase, now_ns


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def inside(p_local_enu_m: Vector3, limits: GateLimits) -> Vector3:
    """The place itself, or the nearest to it that lies a little inside the fence and above the least height: where to
    stand, and to begin the next leg, after the gate has refused one."""
    low = (*limits.fence_min_m[:2], max(limits.fence_min_m[2], limits.min_height_m))
    x, y, z = (
        max(a + margin, min(b - margin, p))
        for p, a, b in zip(p_local_enu_m, low, limits.fence_max_m, strict=True)
        for margin in (min(_FENCE_MARGIN_M, (b - a) / 2),)
    )
    reach_m = max(0.0, limits.fence_radius_m - _FENCE_MARGIN_M)
    scale = min(1.0, reach_m / max(math.hypot(x, y), 1e-9))
    return scale * x, scale * y, z


def as_velocity(setpoint: Setpoint, p_local_enu_m: Vector3, limits: GateLimits) -> Setpoint:
    """The same set point as a velocity alone: its own, and back to its position from where the vehicle is, within the
    speed and climb limits."""
    assert setpoint.p_local_enu_m is not None
    vx, vy, vz = (
        v + _PULL_PER_S * (wanted - now)
        for v, wanted, now in zip(setpoint.v_local_enu_m_s, setpoint.p_local_enu_m, p_local_enu_m, strict=True)
    )
    scale = min(1.0, limits.max_speed_m_s / max(math.hypot(vx, vy), 1e-9))
    climb = max(-limits.max_climb_m_s, min(limits.max_climb_m_s, vz))
    return Setpoint(setpoint.t_mono_ns, None, (scale * vx, scale * vy, climb), setpoint.yaw_enu_rad)
