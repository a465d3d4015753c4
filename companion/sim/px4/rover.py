"""A rover with two driven sides, as PX4 1.16's `rover_differential` drives it: it turns to where it is to go, on the
spot when that is far from where it looks, and drives there. Heights mean nothing to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.sim.px4.airframe import Airframe, AirframeLimits, Demand, Gusts


@dataclass(frozen=True, slots=True)
class RoverLimits:
    """By the names of PX4's parameters, beside them."""

    speed_m_s: float = 1.5
    """RO_SPEED_LIM"""
    acceleration_m_s2: float = 1.5
    """RO_ACCEL_LIM"""
    yaw_rate_rad_s: float = math.radians(90)
    """RO_YAW_RATE_LIM"""
    yaw_gain_per_s: float = 5.0
    """RO_YAW_P"""
    stop_to_turn_rad: float = 0.174533
    """RD_TRANS_DRV_TRN"""
    turned_rad: float = 0.0872665
    """RD_TRANS_TRN_DRV"""
    arrived_m: float = 0.5
    """NAV_ACC_RAD: so near to a place it stands."""
    nearing_per_s: float = 0.5


class RoverFrame(Airframe):
    """True motion in ENU in the plane of the start, along the nose."""

    def __init__(self, yaw_enu_rad: float, gusts: Gusts | None, limits: RoverLimits = RoverLimits()) -> None:
        super().__init__(AirframeLimits(acceleration_m_s2=limits.acceleration_m_s2), yaw_enu_rad, gusts)
        self._rover = limits
        self._speed_m_s = 0.0
        self._turns = False

    def rest(self) -> None:
        super().rest()
        self._speed_m_s, self._turns = 0.0, False

    def step(self, demand: Demand, dt_s: float) -> None:
        if self._gusts is not None:
            self._gusts.step(dt_s)  # the error of the estimate; wind moves no rover
        limits = self._rover
        speed_m_s, bearing_rad = self._wanted(demand)
        error_rad = math.remainder(bearing_rad - self.yaw_enu_rad, math.tau)
        self._turns = abs(error_rad) > (limits.turned_rad if self._turns else limits.stop_to_turn_rad)
        rate = max(-limits.yaw_rate_rad_s, min(limits.yaw_rate_rad_s, limits.yaw_gain_per_s * error_rad))
        self.yaw_enu_rad = math.remainder(self.yaw_enu_rad + rate * dt_s, math.tau)
        change = (0.0 if self._turns else speed_m_s) - self._speed_m_s
        most = limits.acceleration_m_s2 * dt_s
        self._speed_m_s += max(-most, min(most, change))
        vx, vy = self._speed_m_s * math.cos(self.yaw_enu_rad), self._speed_m_s * math.sin(self.yaw_enu_rad)
        x, y, _ = self.p_enu_m
        self.p_enu_m, self.v_enu_m_s = (x + vx * dt_s, y + vy * dt_s, 0.0), (vx, vy, 0.0)

    def _wanted(self, demand: Demand) -> tuple[float, float]:
        """Speed and direction. A place has precedence; a velocity of 0 points North, as in PX4."""
        x, y, _ = demand.p_enu_m
        here_x, here_y, _ = self.estimated_p_enu_m
        if x is not None and y is not None:
            away_m = math.hypot(x - here_x, y - here_y)
            if away_m < self._rover.arrived_m:
                return 0.0, self.yaw_enu_rad
            speed_m_s = min(self._rover.speed_m_s, self._rover.nearing_per_s * away_m)
            return speed_m_s, math.atan2(y - here_y, x - here_x)
        vx, vy, _ = demand.v_enu_m_s
        if vx == vy == 0.0:
            return 0.0, math.pi / 2
        return min(self._rover.speed_m_s, math.hypot(vx, vy)), math.atan2(vy, vx)
