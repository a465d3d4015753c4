"""Resets of the estimate that PX4 announces (ODOMETRY.reset_counter), as an offset that set points can follow. Pure."""

from __future__ import annotations

import math
from typing import Final

from companion.core.messages import Pose, Vector3

_NOISE_M: Final = 0.1
"""A smaller step at a raised counter is motion: the reset was of something else (velocity, heading)."""


class PositionResets:
    """`count` is how often the counter rose, `offset_enu_m` how far positions have been moved by that in all."""

    def __init__(self) -> None:
        self.count = 0
        self.offset_enu_m: Vector3 = (0.0, 0.0, 0.0)
        self._before: tuple[Pose, int] | None = None

    def forget(self) -> None:
        """What comes next is of another estimate altogether."""
        self._before = None

    def take(self, pose: Pose, reset_counter: int) -> bool:
        """The estimate, stamped by the clock of the vehicle. True when it has been reset."""
        before, self._before = self._before, (pose, reset_counter)
        if before is None or before[1] == reset_counter:
            return False
        self.count += (reset_counter - before[1]) & 0xFF
        dt_s = (pose.t_mono_ns - before[0].t_mono_ns) / 1e9
        step = [
            now - then - v * dt_s
            for now, then, v in zip(pose.p_enu_m, before[0].p_enu_m, before[0].v_enu_m_s, strict=True)
        ]
        if math.hypot(*step) > _NOISE_M:
            x, y, z = (o + d for o, d in zip(self.offset_enu_m, step, strict=True))
            self.offset_enu_m = (x, y, z)
        return True
