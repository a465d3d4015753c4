"""Set points of a vehicle that drives: velocities in the plane, and a place to stand."""

from __future__ import annotations

import math
from typing import Final

from companion.core.messages import Setpoint, Vector3

_STANDS_M_S: Final = 0.05
"""Slower than this the vehicle is to stand."""


def in_plane(setpoint: Setpoint, p_local_enu_m: Vector3) -> Setpoint:
    """A set point of velocity alone, of a vehicle at `p_local_enu_m`, without height and heading.

    A PX4 rover turns to where its velocity points and drives there; a velocity of 0 points North, and it would turn on
    the spot. So standing is said by the place where it is.
    """
    vx, vy, _ = setpoint.v_local_enu_m_s
    if math.hypot(vx, vy) < _STANDS_M_S:
        return Setpoint(setpoint.t_mono_ns, p_local_enu_m, (0.0, 0.0, 0.0), None)
    return Setpoint(setpoint.t_mono_ns, None, (vx, vy, 0.0), None)
