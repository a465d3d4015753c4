"""A multicopter as a point with limits: velocity follows a demand with bounded speed and acceleration."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from companion.core.messages import Vector3

_POSITION_GAIN_PER_S = 0.95
"""MPC_XY_P and MPC_Z_P: metres of error to m/s."""
_VELOCITY_GAIN_PER_S = 4.0


@dataclass(frozen=True, slots=True)
class Demand:
    """What a flight mode wants of the airframe: hold `p_enu_m` where given, fly `v_enu_m_s` on top, turn to yaw."""

    p_enu_m: tuple[float | None, float | None, float | None]
    v_enu_m_s: Vector3
    yaw_enu_rad: float | None = None


@dataclass(frozen=True, slots=True)
class AirframeLimits:
    speed_m_s: float = 5.0
    climb_m_s: float = 3.0
    sink_m_s: float = 1.5
    acceleration_m_s2: float = 3.0
    yaw_rate_rad_s: float = math.radians(60)


class Gusts:
    """Seeded disturbance: an acceleration and an estimator error, both first-order Gauss-Markov processes."""

    def __init__(self, seed: int, gust_m_s2: float = 0.25, estimate_m: float = 0.03) -> None:
        self._random = random.Random(seed)
        self._gust_m_s2 = gust_m_s2
        self._estimate_m = estimate_m
        self.acceleration_enu_m_s2: Vector3 = (0.0, 0.0, 0.0)
        self.estimate_error_enu_m: Vector3 = (0.0, 0.0, 0.0)

    def step(self, dt_s: float) -> None:
        self.acceleration_enu_m_s2 = self._walk(self.acceleration_enu_m_s2, self._gust_m_s2, 1.0, dt_s)
        self.estimate_error_enu_m = self._walk(self.estimate_error_enu_m, self._estimate_m, 5.0, dt_s)

    def _walk(self, value: Vector3, sigma: float, tau_s: float, dt_s: float) -> Vector3:
        keep = math.exp(-dt_s / tau_s)
        kick = sigma * math.sqrt(1 - keep * keep)
        (x, y, z), gauss = value, self._random.gauss
        return keep * x + kick * gauss(), keep * y + kick * gauss(), keep * z + kick * gauss()


class Airframe:
    """True motion in ENU from the start on the ground (z = 0), and the position the estimator believes."""

    def __init__(self, limits: AirframeLimits, yaw_enu_rad: float, gusts: Gusts | None) -> None:
        self.limits = limits
        self.p_enu_m: Vector3 = (0.0, 0.0, 0.0)
        self.v_enu_m_s: Vector3 = (0.0, 0.0, 0.0)
        self.yaw_enu_rad = yaw_enu_rad
        self.estimate_offset_enu_m: Vector3 = (0.0, 0.0, 0.0)
        """How far the estimate is from the truth, beside the gusts' error of it: drift, vision, resets."""
        self._gusts = gusts

    @property
    def estimated_p_enu_m(self) -> Vector3:
        ex, ey, ez = (0.0, 0.0, 0.0) if self._gusts is None else self._gusts.estimate_error_enu_m
        (x, y, z), (ox, oy, oz) = self.p_enu_m, self.estimate_offset_enu_m
        return (x + ox + ex, y + oy + ey, z + oz + ez)

    @property
    def on_ground(self) -> bool:
        return self.p_enu_m[2] <= 0

    def stopping_point_enu_m(self) -> Vector3:
        """Where the vehicle would come to rest if it braked now."""
        speed = math.hypot(*self.v_enu_m_s)
        brake_s = speed / (2 * self.limits.acceleration_m_s2)
        x, y, z = (p + v * brake_s for p, v in zip(self.estimated_p_enu_m, self.v_enu_m_s, strict=True))
        return (x, y, max(z, self.estimate_offset_enu_m[2]))

    def rest(self) -> None:
        """Motors off: on the ground nothing moves, in the air this mock does not fall."""
        self.v_enu_m_s = (0.0, 0.0, 0.0)

    def step(self, demand: Demand, dt_s: float) -> None:
        if self._gusts is not None:
            self._gusts.step(dt_s)
        ax, ay, az = self._acceleration(self._velocity(demand))
        (x, y, z), (vx, vy, vz) = self.p_enu_m, self.v_enu_m_s
        x = x + vx * dt_s + ax * dt_s * dt_s / 2
        y = y + vy * dt_s + ay * dt_s * dt_s / 2
        z = z + vz * dt_s + az * dt_s * dt_s / 2
        vx, vy, vz = vx + ax * dt_s, vy + ay * dt_s, vz + az * dt_s
        self.p_enu_m, self.v_enu_m_s = (x, y, z), (vx, vy, vz)
        if z <= 0:
            self.p_enu_m, self.v_enu_m_s = (x, y, 0.0), (0.0, 0.0, max(vz, 0.0))
        if demand.yaw_enu_rad is not None:
            step = self.limits.yaw_rate_rad_s * dt_s
            error = math.remainder(demand.yaw_enu_rad - self.yaw_enu_rad, math.tau)
            self.yaw_enu_rad = math.remainder(self.yaw_enu_rad + max(-step, min(step, error)), math.tau)

    def _velocity(self, demand: Demand) -> Vector3:
        (x, y, z), (px, py, pz), (now_x, now_y, now_z) = demand.v_enu_m_s, demand.p_enu_m, self.estimated_p_enu_m
        x = x if px is None else x + _POSITION_GAIN_PER_S * (px - now_x)
        y = y if py is None else y + _POSITION_GAIN_PER_S * (py - now_y)
        z = z if pz is None else z + _POSITION_GAIN_PER_S * (pz - now_z)
        scale = min(1.0, self.limits.speed_m_s / max(math.hypot(x, y), 1e-9))
        return (x * scale, y * scale, max(-self.limits.sink_m_s, min(self.limits.climb_m_s, z)))

    def _acceleration(self, v_wanted: Vector3) -> Vector3:
        (x, y, z), (vx, vy, vz) = v_wanted, self.v_enu_m_s
        x, y, z = _VELOCITY_GAIN_PER_S * (x - vx), _VELOCITY_GAIN_PER_S * (y - vy), _VELOCITY_GAIN_PER_S * (z - vz)
        scale = min(1.0, self.limits.acceleration_m_s2 / max(math.hypot(x, y, z), 1e-9))
        gx, gy, gz = (0.0, 0.0, 0.0) if self._gusts is None or self.on_ground else self._gusts.acceleration_enu_m_s2
        return (scale * x + gx, scale * y + gy, scale * z + gz)
