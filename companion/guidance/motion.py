"""The commanded motion: velocities that are wished for in; a path whose position, velocity and acceleration never step
out.

A second-order filter of the wished velocity with limits on acceleration and jerk, integrated once more: whatever is
wished, and however suddenly, the vehicle is given a position and a velocity that agree with each other.
"""

from __future__ import annotations

import math
from typing import Final

from companion.core.messages import Vector3

_RATE_PER_S: Final = 5.0
"""How fast the velocity follows, critically damped: a wish is met to 4 % after a second."""
_MAX_JERK_M_S3: Final = 8.0
"""0.4 m/s2 between two ticks of 20 Hz."""
_LONGEST_STEP_S: Final = 0.1
_SUBSTEP_S: Final = 0.025


class Motion:
    """Position, velocity and acceleration in the local frame (ENU axes)."""

    def __init__(self, max_acceleration_m_s2: float) -> None:
        self._max_acceleration_m_s2 = max_acceleration_m_s2
        self.p_m: Vector3 = (0.0, 0.0, 0.0)
        self.v_m_s: Vector3 = (0.0, 0.0, 0.0)
        self._a_m_s2: Vector3 = (0.0, 0.0, 0.0)

    def start(self, p_m: Vector3, v_m_s: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """From here on, as the vehicle is."""
        self.p_m, self.v_m_s, self._a_m_s2 = p_m, v_m_s, (0.0, 0.0, 0.0)

    def shift(self, delta_m: Vector3) -> None:
        """All places are `delta_m` elsewhere."""
        self.p_m = _sum(self.p_m, delta_m)

    def step(self, wished_m_s: Vector3, dt_s: float) -> None:
        """Goes on for `dt_s`, which counts for at most 0.1 s: a late tick must not make a leap."""
        left_s = min(dt_s, _LONGEST_STEP_S)
        while left_s > 1e-9:
            step_s = min(left_s, _SUBSTEP_S)
            left_s -= step_s
            self._step(wished_m_s, step_s)

    def _step(self, wished_m_s: Vector3, dt_s: float) -> None:
        (wx, wy, wz), (vx, vy, vz), (ax, ay, az) = wished_m_s, self.v_m_s, self._a_m_s2
        jerk = _jerk_m_s3(wx, vx, ax), _jerk_m_s3(wy, vy, ay), _jerk_m_s3(wz, vz, az)
        scale = dt_s * min(1.0, _MAX_JERK_M_S3 / max(math.hypot(*jerk), 1e-9))
        a = ax + scale * jerk[0], ay + scale * jerk[1], az + scale * jerk[2]
        self._a_m_s2 = _scaled(a, min(1.0, self._max_acceleration_m_s2 / max(math.hypot(*a), 1e-9)))
        self.v_m_s = _sum(self.v_m_s, _scaled(self._a_m_s2, dt_s))
        self.p_m = _sum(self.p_m, _scaled(self.v_m_s, dt_s))


def _jerk_m_s3(wished_m_s: float, v_m_s: float, a_m_s2: float) -> float:
    """Of one axis, before its limit."""
    return _RATE_PER_S**2 * (wished_m_s - v_m_s) - 2 * _RATE_PER_S * a_m_s2


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(a: Vector3, by: float) -> Vector3:
    return by * a[0], by * a[1], by * a[2]
