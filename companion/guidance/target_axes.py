"""What a target takes for North: its own way, seen from here, is turned by as much as that is off.

A target tells its poses in axes that point North as well as somebody aligned them. While it stands that says nothing.
Once it drives, each place it may be at goes on in a direction of its own, and apertures, whose path is made of both
robots' ways, are bent.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.sensing.frame_turn import NORTH_STD_RAD
from companion.sensing.records import Bearing

_Floats = npt.NDArray[np.float64]

AXES_STD_RAD: Final = NORTH_STD_RAD
"""A target knows North no better than the vehicle before it has moved."""


def drawn_axes(rng: np.random.Generator, count: int) -> _Floats:
    """(count,) by how much the target's axes are turned counter-clockwise against its true way [rad]."""
    return rng.normal(0.0, AXES_STD_RAD, count)


def carried_m(axes_rad: _Floats, driven_m: _Floats) -> _Floats:
    """(N, 3) how much farther places of the target go than its own poses say (3,), which are off by (N,)."""
    c, s = np.cos(axes_rad) - 1.0, np.sin(axes_rad)
    east, north, _ = driven_m
    return np.stack([c * east - s * north, s * east + c * north, np.zeros(len(axes_rad))], axis=1)


def share_driven(before: Bearing, bearing: Bearing) -> float:
    """What of the path between two bearings, as an aperture sees it, is the target's own way."""
    way_m = np.subtract(bearing.target_p_enu_m, before.target_p_enu_m)
    path_m = np.subtract(bearing.p_local_enu_m, before.p_local_enu_m) - way_m
    return math.hypot(*way_m) / max(math.hypot(*way_m), math.hypot(*path_m), 1e-9)
