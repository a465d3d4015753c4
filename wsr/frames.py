"""Axes of other devices to and from the world's East, North, Up. Vectors are (..., 3), quaternions (..., 4) w, x, y, z.

The T265 reports in axes X right, Y up, Z back, for the world (levelled, arbitrary yaw) as for the camera body. Here
the body is forward, left, up: the camera looks along body x. A camera that has just started looks along world -Z,
which is mapped to North; `yaw_align` then turns that to where it truly looks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.geometry import quaternion_conjugate, quaternion_from_yaw, quaternion_multiply, rotation_z

Array = NDArray[np.float64]

# World: a quarter turn about x takes (X, Y, Z) to (X, -Z, Y).
_Q_ENU_FROM_T265 = np.array([math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0])
# Body: forward = -Z, left = -X, up = Y, which is a third of a turn.
_Q_FLU_FROM_T265 = np.array([0.5, 0.5, -0.5, -0.5])


def enu_from_ned(v_ned: ArrayLike) -> Array:
    """(north, east, down) to (east, north, up)."""
    v = np.asarray(v_ned, float)
    return np.stack([v[..., 1], v[..., 0], -v[..., 2]], axis=-1)


def ned_from_enu(v_enu: ArrayLike) -> Array:
    """(east, north, up) to (north, east, down)."""
    return enu_from_ned(v_enu)  # the swap with the sign is its own inverse


def enu_of_ned(north: float, east: float, down: float) -> tuple[float, float, float]:
    """`enu_from_ned` of one vector as plain numbers: a telemetry stream's cheap way."""
    return east, north, -down


def ned_of_enu(east: float, north: float, up: float) -> tuple[float, float, float]:
    """The inverse of `enu_of_ned`."""
    return north, east, -up


def yaw_enu_from_ned(heading_rad: float) -> float:
    """Compass heading (clockwise from North) to yaw counter-clockwise from East, in [-pi, pi)."""
    return (math.pi / 2 - heading_rad + math.pi) % (2 * math.pi) - math.pi


def yaw_ned_from_enu(yaw_rad: float) -> float:
    """Yaw counter-clockwise from East to compass heading (clockwise from North), in [-pi, pi)."""
    return (math.pi / 2 - yaw_rad + math.pi) % (2 * math.pi) - math.pi


def enu_from_t265_vector(v_t265: ArrayLike) -> Array:
    """Position or velocity of the T265's world: E = x, N = -z, U = y."""
    v = np.asarray(v_t265, float)
    return np.stack([v[..., 0], -v[..., 2], v[..., 1]], axis=-1)


def enu_from_t265_quaternion(q_t265: ArrayLike) -> Array:
    """Attitude of the forward-left-up body in ENU from the T265's own (its body in its world): W q B^-1."""
    turned = quaternion_multiply(_Q_ENU_FROM_T265, q_t265)
    return quaternion_multiply(turned, quaternion_conjugate(_Q_FLU_FROM_T265))


def yaw_align(yaw_rad: float, value: ArrayLike) -> Array:
    """Turn a world-frame vector (..., 3) or attitude (..., 4) counter-clockwise about Up.

    The turn is multiplied from the LEFT: it moves the world frame. From the right it would turn the body instead and
    leave a pitched or rolled attitude wrong. Raises ValueError if the last axis is neither 3 nor 4.
    """
    array = np.asarray(value, float)
    if array.shape[-1] == 3:
        return np.asarray(array @ rotation_z(yaw_rad).T)
    if array.shape[-1] == 4:
        return quaternion_multiply(quaternion_from_yaw(yaw_rad), array)
    raise ValueError(f"the last axis has {array.shape[-1]} entries; a vector has 3, a quaternion 4")
