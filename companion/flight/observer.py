"""Observe mode: somebody else flies or carries the vehicle, and everything is computed but nothing is sent."""

from __future__ import annotations

import math

from companion.config.schema import ApertureConfig, MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3
from companion.sensing.iterations import SarIterations

_LONGEST_S = 20.0
_LOOK_S = 0.5
_LEAD_S = 0.5


class Observer:
    """Cuts the motion of whoever moves the vehicle into SAR iterations."""

    def __init__(self, sar: SarIterations, config: ApertureConfig) -> None:
        self._sar = sar
        self._config = config
        self._began_ns = 0
        self._looked_ns = 0
        self._ended_ns: int | None = None

    def tick(self, now_ns: int) -> None:
        """A path as long as a leg ends an iteration, and so does a long time without one."""
        if self._ended_ns is not None:
            if now_ns - self._ended_ns >= self._config.settle_s * NS_PER_S:
                self._sar.finish(self._ended_ns)
                self._ended_ns = None
        elif not self._sar.is_measuring:
            if not self._sar.is_waiting:
                self._sar.begin()
                self._began_ns = now_ns
        elif now_ns - self._looked_ns >= _LOOK_S * NS_PER_S:
            self._looked_ns = now_ns
            is_long = self._sar.path_length_m() >= self._config.length_m
            if is_long or now_ns - self._began_ns >= _LONGEST_S * NS_PER_S:
                self._ended_ns = now_ns


def would_be_setpoint(
    now_ns: int, p_local_enu_m: Vector3, azimuth_rad: float, mission: MissionConfig, height_m: float
) -> Setpoint:
    """The set point that a leg to the target would begin with: for the log, and judged by the gate like any other."""
    vx, vy = mission.speed_m_s * math.cos(azimuth_rad), mission.speed_m_s * math.sin(azimuth_rad)
    x, y, _ = p_local_enu_m
    return Setpoint(now_ns, (x + _LEAD_S * vx, y + _LEAD_S * vy, height_m), (vx, vy, 0.0), azimuth_rad)
