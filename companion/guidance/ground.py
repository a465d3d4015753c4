"""What is other for a vehicle that drives: set points in the plane, a place to stand, apertures without up and down."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from companion.core.messages import Setpoint, Vector3
from companion.guidance.approach import as_velocity
from companion.safety.gate import GateLimits
from companion.sensing.records import Bearing

_STANDS_M_S: Final = 0.05
"""Slower than this the vehicle is to stand."""


def in_plane(setpoint: Setpoint, p_local_enu_m: Vector3, limits: GateLimits) -> Setpoint:
    """A set point of the path as a velocity alone, of a vehicle at `p_local_enu_m`, without height and heading. Where
    the path stands the vehicle does, wherever it is.

    A PX4 rover turns to where its velocity points and drives there; a velocity of 0 points North, and it would turn on
    the spot. So standing is said by the place where it is.
    """
    vx, vy, _ = setpoint.v_local_enu_m_s
    if math.hypot(vx, vy) < _STANDS_M_S:
        return Setpoint(setpoint.t_mono_ns, p_local_enu_m, (0.0, 0.0, 0.0), None)
    vx, vy, _ = as_velocity(setpoint, p_local_enu_m, limits).v_local_enu_m_s
    return Setpoint(setpoint.t_mono_ns, None, (vx, vy, 0.0), None)


def above_horizon(bearing: Bearing) -> Bearing:
    """A bearing of a level path, which tells a direction and its mirror image below the path's plane alike: as the one
    above, where the robot must be."""
    others = tuple(replace(path, polar_rad=_folded(path.polar_rad)) for path in bearing.others)
    return replace(bearing, polar_rad=_folded(bearing.polar_rad), others=others)


def _folded(polar_rad: float) -> float:
    return min(polar_rad, math.pi - polar_rad)
