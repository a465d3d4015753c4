"""Where a target can be flown to: inside the fence or a little beyond it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.safety.gate import GateLimits

_Floats = npt.NDArray[np.float64]


class Reach:
    """Of a fence, `range_m` beyond it. A room's fence keeps the mirror images out, which stand behind its walls."""

    def __init__(self, limits: GateLimits, range_m: float) -> None:
        self._low_m: Final = np.array(limits.fence_min_m) - range_m
        self._high_m: Final = np.array(limits.fence_max_m) + range_m
        self._radius_m: Final = limits.fence_radius_m + range_m
        yaw_rad = math.radians(limits.fence_yaw_deg)
        self._axes: Final = np.array(
            [[math.cos(yaw_rad), math.sin(yaw_rad), 0.0], [-math.sin(yaw_rad), math.cos(yaw_rad), 0.0], [0.0, 0.0, 1.0]]
        )

    def __call__(self, p_local_enu_m: _Floats) -> npt.NDArray[np.bool_]:
        """Whether places (N, 3) are within it, (N,)."""
        own_m = np.einsum("ij,nj->ni", self._axes, p_local_enu_m)
        inside = np.all((self._low_m <= own_m) & (own_m <= self._high_m), axis=1)
        return np.asarray(inside & (np.hypot(own_m[:, 0], own_m[:, 1]) <= self._radius_m))
