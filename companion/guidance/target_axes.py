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
_LEAST_JUMP_M, _FASTEST_M_S = 0.5, 1.5
"""Who is followed drives no faster: a longer step is not driven. Bearings before and after a jump are seconds apart,
for no aperture spans one."""


def drawn_axes(rng: np.random.Generator, count: int) -> _Floats:
    """(count,) by how much the target's axes are turned counter-clockwise against its true way [rad]."""
    return rng.normal(0.0, AXES_STD_RAD, count)


def carried_m(axes_rad: _Floats, driven_m: _Floats) -> _Floats:
    """(N, 3) how much farther places of the target go than its own poses say (3,), which are off by (N,)."""
    c, s = np.cos(axes_rad) - 1.0, np.sin(axes_rad)
    east, north, _ = driven_m
    return np.stack([c * east - s * north, s * east + c * north, np.zeros(len(axes_rad))], axis=1)


def jumped_m(before: Bearing, bearing: Bearing) -> _Floats:
    """(3,) what the target's own poses have jumped between two bearings: all of a way that nobody drives. Its camera
    has found itself elsewhere; the target is where it was."""
    way_m = np.subtract(bearing.target_p_enu_m, before.target_p_enu_m)
    elapsed_s = max(0.0, bearing.t_mono_ns - before.t_mono_ns) / 1e9
    return way_m if math.hypot(*way_m) > max(_LEAST_JUMP_M, _FASTEST_M_S * elapsed_s) else np.zeros(3)


def bend_rad(before: Bearing, bearing: Bearing) -> float:
    """Deviation of a bearing whose aperture, our path less the target's, is put together in axes that differ by what
    both know of North. The target's way along the line of sight bends nothing."""
    way_m = np.subtract(bearing.target_p_enu_m, before.target_p_enu_m)
    path_m = np.subtract(bearing.p_local_enu_m, before.p_local_enu_m) - way_m
    across_m = abs(way_m[1] * math.cos(bearing.azimuth_rad) - way_m[0] * math.sin(bearing.azimuth_rad))
    share = across_m / max(math.hypot(*way_m), math.hypot(*path_m), 1e-9)
    return float(math.hypot(AXES_STD_RAD, bearing.turn.yaw_rad, bearing.turn.std_rad) * share)
