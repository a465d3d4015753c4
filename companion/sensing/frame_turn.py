"""How the pose source's axes are turned against the autopilot's local frame, as the flight itself shows it.

Bearings come in the pose source's axes, whose North is known to some degrees; the vehicle is flown in the autopilot's
local frame. Both have seen the same path. What turns one path into the other (Kabsch, Acta Cryst. A32, 1976, in the
plane) turns bearings too. Where the autopilot's position is made of our poses the turn is none, whatever North is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

NORTH_STD_RAD: Final = math.radians(9.0)
"""How well North is known before the flight shows it."""
DRIFT: Final = 0.025
"""Share of the way by which a T265's poses part from the truth along each axis (study `vio`)."""
DRIFT_ALIKE_M: Final = 5.0
"""Over so much of a way poses drift off in the same direction."""
_WANDER_M: Final = 0.05
"""By so much the autopilot's position wanders on the way."""
_LEAST_M: Final = 0.2


@dataclass(frozen=True, slots=True)
class FrameTurn:
    """Counter-clockwise from the pose source's axes to the local frame's, with its deviation."""

    yaw_rad: float
    std_rad: float


UNKNOWN: Final = FrameTurn(0.0, NORTH_STD_RAD)
"""Before the vehicle has moved."""


def frame_turn(posed_m: Floats, local_m: Floats, drift: float) -> FrameTurn:
    """Of one path (N, 2), East and North, as the pose source and the autopilot saw it at the same times. Poses drift
    off by a share `drift` of the way. What both show counts against what was known before."""
    if len(posed_m) < 2:
        return UNKNOWN
    posed, local = (p_m - p_m.mean(axis=0) for p_m in (posed_m, local_m))
    spread_m2 = float(np.mean(posed**2) * 2)
    length_m = math.sqrt(12.0 * spread_m2)  # of a straight path with that spread
    if length_m < _LEAST_M:
        return UNKNOWN
    along = float(np.sum(posed * local))
    across = float(np.sum(posed[:, 0] * local[:, 1] - posed[:, 1] * local[:, 0]))
    yaw_rad = math.atan2(across, along)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    left_m = local - posed @ np.array([[c, s], [-s, c]])
    off_m = math.hypot(_WANDER_M, math.sqrt(float(np.mean(left_m**2))))
    drift_rad = drift * math.sqrt(DRIFT_ALIKE_M / max(DRIFT_ALIKE_M, length_m))
    shown = 1.0 / (drift_rad**2 + off_m**2 / spread_m2)
    before = NORTH_STD_RAD**-2
    return FrameTurn(yaw_rad * shown / (shown + before), (shown + before) ** -0.5)
