"""Directions on the sphere and rotations: azimuth counter-clockwise from x, polar angle from +z; quaternions wxyz.

All functions broadcast over leading axes and work in float64.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def direction(azimuth_rad: ArrayLike, polar_rad: ArrayLike) -> Array:
    """Unit vectors (..., 3): u = (sin t cos p, sin t sin p, cos t) for azimuth p and polar angle t."""
    azimuth, polar = np.asarray(azimuth_rad, float), np.asarray(polar_rad, float)
    sine = np.sin(polar)
    x = sine * np.cos(azimuth)
    result = np.empty((*x.shape, 3))
    result[..., 0] = x
    result[..., 1] = sine * np.sin(azimuth)
    result[..., 2] = np.cos(polar)
    return result


def angles(vector: ArrayLike) -> tuple[Array, Array]:
    """Azimuth in (-pi, pi] and polar angle in [0, pi] of vectors (..., 3) of any length but zero."""
    v = np.asarray(vector, float)
    horizontal = np.hypot(v[..., 0], v[..., 1])
    return np.asarray(np.arctan2(v[..., 1], v[..., 0])), np.asarray(np.arctan2(horizontal, v[..., 2]))


def wrap_angle(angle_rad: ArrayLike) -> Array:
    """The same angles in [-pi, pi)."""
    return np.asarray(np.mod(np.asarray(angle_rad, float) + np.pi, 2 * np.pi) - np.pi)


def cross(a: Array, b: Array) -> Array:
    """Vector products (..., 3), as np.cross, which takes five times as long over a single one."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    result = np.empty((*x.shape, 3))
    result[..., 0] = x
    result[..., 1] = az * bx - ax * bz
    result[..., 2] = ax * by - ay * bx
    return result


def perpendicular(u: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) across a unit vector (3,) and each other: the rows of Householder's reflection of u onto
    the first axis."""
    x, y, z = (float(value) for value in u)
    scale, sign = 1.0 / (1.0 + abs(x)), math.copysign(1.0, x)
    return (
        np.array([-sign * y, 1.0 - y * y * scale, -y * z * scale]),
        np.array([-sign * z, -y * z * scale, 1.0 - z * z * scale]),
    )


def great_circle(u: ArrayLike, v: ArrayLike) -> Array:
    """Angle in [0, pi] between vectors (..., 3); exact for tiny angles too, where arccos of the dot product is not."""
    a, b = np.asarray(u, float), np.asarray(v, float)
    return np.asarray(np.arctan2(np.linalg.norm(cross(a, b), axis=-1), np.sum(a * b, axis=-1)))


def rotation_z(yaw_rad: float) -> Array:
    """Rotation matrix (3, 3) that turns vectors counter-clockwise about z."""
    cosine, sine = float(np.cos(yaw_rad)), float(np.sin(yaw_rad))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def rotate(q_wxyz: ArrayLike, v: ArrayLike) -> Array:
    """Vectors (..., 3) turned by unit quaternions (..., 4): v + 2 w (r x v) + 2 r x (r x v)."""
    q, vector = np.asarray(q_wxyz, float), np.asarray(v, float)
    w, r = q[..., :1], q[..., 1:]
    across = cross(r, vector)
    return np.asarray(vector + 2.0 * (w * across + cross(r, across)))


def quaternion_multiply(a_wxyz: ArrayLike, b_wxyz: ArrayLike) -> Array:
    """Hamilton product (..., 4): the rotation b first, then a."""
    a, b = np.asarray(a_wxyz, float), np.asarray(b_wxyz, float)
    aw, ar, bw, br = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - np.sum(ar * br, axis=-1, keepdims=True)
    return np.concatenate([w, aw * br + bw * ar + cross(ar, br)], axis=-1)


def quaternion_conjugate(q_wxyz: ArrayLike) -> Array:
    """Inverse rotations of unit quaternions (..., 4)."""
    return np.asarray(np.asarray(q_wxyz, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def quaternion_from_yaw(yaw_rad: ArrayLike) -> Array:
    """Quaternions (..., 4) of a turn counter-clockwise about z."""
    half = np.asarray(yaw_rad, float) / 2.0
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def yaw_of(q_wxyz: ArrayLike) -> Array:
    """Yaw of quaternions (..., 4): the azimuth of the rotated x axis, in (-pi, pi]."""
    forward = rotate(q_wxyz, np.array([1.0, 0.0, 0.0]))
    return np.asarray(np.arctan2(forward[..., 1], forward[..., 0]))
