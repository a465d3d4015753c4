"""What each of PX4's own modes asks of the airframe: heights and paths of takeoff, return and landing. Pure."""

from __future__ import annotations

import math
from typing import Final

from companion.core.messages import Vector3
from companion.sim.px4.airframe import Demand
from companion.sim.px4.parameters import Parameters

_LAND_SLOW_M, _LAND_FAST_M = 5.0, 10.0
"""MPC_LAND_ALT2 and MPC_LAND_ALT1: landing is slow below, and as fast as the vehicle sinks above."""
_SINK_M_S: Final = 1.5
_AT_HOME_M: Final = 0.5


def landing(p_enu_m: Vector3, home_enu_m: Vector3, place: tuple[float | None, float | None], slow_m_s: float) -> Demand:
    """Down at `place`, or without a place to hold (None) wherever the vehicle drifts."""
    share = (p_enu_m[2] - home_enu_m[2] - _LAND_SLOW_M) / (_LAND_FAST_M - _LAND_SLOW_M)
    sink_m_s = slow_m_s + (_SINK_M_S - slow_m_s) * min(1.0, max(0.0, share))
    return Demand((*place, None), (0.0, 0.0, -sink_m_s))


def return_height_m(p_enu_m: Vector3, home_enu_m: Vector3, parameters: Parameters) -> float:
    """Up at which it flies home: RTL_RETURN_ALT, or the cone of RTL_CONE_ANG near home; never lower than it is."""
    distance_m = math.hypot(p_enu_m[0] - home_enu_m[0], p_enu_m[1] - home_enu_m[1])
    highest_m, near_m = float(parameters["RTL_RETURN_ALT"]), float(parameters["NAV_ACC_RAD"])
    cone_deg = float(parameters["RTL_CONE_ANG"])
    height_m = highest_m
    if cone_deg > 0 and distance_m <= near_m:
        height_m = 2 * distance_m
    elif cone_deg > 0:
        if distance_m <= float(parameters["RTL_MIN_DIST"]):
            height_m = min(height_m, distance_m / math.tan(math.radians(min(89.0, cone_deg))))
        height_m = max(height_m, 2 * near_m)
    return home_enu_m[2] + max(min(height_m, highest_m), p_enu_m[2] - home_enu_m[2])


class Return:
    """One return: climb where it began, over to home, down to the ground."""

    def __init__(self, p_enu_m: Vector3, home_enu_m: Vector3, parameters: Parameters) -> None:
        self._home_m = home_enu_m
        self._start_m = p_enu_m
        self._slow_m_s = float(parameters["MPC_LAND_SPEED"])
        self._reach_m = float(parameters["NAV_MC_ALT_RAD"])
        self.height_m = return_height_m(p_enu_m, home_enu_m, parameters)
        self._has_climbed = self._lands = False

    def demand(self, p_enu_m: Vector3) -> Demand:
        x, y, _ = self._home_m
        self._has_climbed = self._has_climbed or p_enu_m[2] > self.height_m - self._reach_m
        self._lands = self._lands or (self._has_climbed and math.hypot(p_enu_m[0] - x, p_enu_m[1] - y) < _AT_HOME_M)
        if self._lands:
            return landing(p_enu_m, self._home_m, (x, y), self._slow_m_s)
        over = (x, y) if self._has_climbed else self._start_m[:2]
        return Demand((*over, self.height_m), (0.0, 0.0, 0.0))


def is_outside_fence(p_enu_m: Vector3, home_enu_m: Vector3, parameters: Parameters) -> bool:
    """Beyond GF_MAX_HOR_DIST or GF_MAX_VER_DIST from home; 0 is no limit."""
    wide_m, high_m = float(parameters["GF_MAX_HOR_DIST"]), float(parameters["GF_MAX_VER_DIST"])
    (x, y, z), (home_x, home_y, home_z) = p_enu_m, home_enu_m
    return 0 < wide_m < math.hypot(x - home_x, y - home_y) or 0 < high_m < z - home_z
