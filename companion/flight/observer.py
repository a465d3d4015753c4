"""Observe mode: somebody else flies or carries the vehicle, and everything is computed but nothing is sent. What would
have been sent is written down.
"""

from __future__ import annotations

import math

from companion.config.schema import MissionConfig
from companion.core.messages import Setpoint, Vector3

_LEAD_S = 0.5


def would_be_setpoint(
    now_ns: int, p_local_enu_m: Vector3, azimuth_rad: float, mission: MissionConfig, height_m: float
) -> Setpoint:
    """The set point that a flight to the target would begin with: for the log, judged by the gate like any other."""
    vx, vy = mission.speed_m_s * math.cos(azimuth_rad), mission.speed_m_s * math.sin(azimuth_rad)
    x, y, _ = p_local_enu_m
    return Setpoint(now_ns, (x + _LEAD_S * vx, y + _LEAD_S * vy, height_m), (vx, vy, 0.0), azimuth_rad)
