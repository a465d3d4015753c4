"""How far the place that an autopilot with GPS believes wanders while it flies."""

from __future__ import annotations

from typing import Final

import numpy as np

from companion.core.messages import Vector3

WANDER_M: Final = np.array([0.2, 0.2, 0.3])
_WANDER_S: Final = 15.0


class Wander:
    """How far an autopilot's estimate of its place is off: smoothly, by `WANDER_M` (1 sigma), forgotten in half a
    minute; in height from nothing on the ground. So it was with PX4 1.16.1, flown with GPS in its own simulator: within
    30 s it moved off by 0.2 m level and 0.4 m in height."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        level_m = WANDER_M * (1.0, 1.0, 0.0)
        self._off_m = level_m * self._rng.normal(size=3)
        self._rate_m_s = level_m / _WANDER_S * self._rng.normal(size=3)

    def step(self, dt_s: float) -> Vector3:
        """Critically damped, driven by white noise."""
        kick_m_s = 2.0 * WANDER_M * (dt_s / _WANDER_S**3) ** 0.5 * self._rng.normal(size=3)
        self._rate_m_s += -(2.0 * self._rate_m_s + self._off_m / _WANDER_S) * (dt_s / _WANDER_S) + kick_m_s
        x, y, z = (self._off_m + self._rate_m_s * dt_s).tolist()
        self._off_m = np.array((x, y, z))
        return x, y, z
