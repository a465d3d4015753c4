"""Positions at packet times, and the displacement that forms the aperture."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.geometry import rotate

Array = NDArray[np.float64]


def interpolate(
    t_s: ArrayLike, pose_t_s: ArrayLike, values: ArrayLike, max_gap_s: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Linear interpolation of values (N, 3) at pose times (N,) to packet times t_s (K,), all in seconds of one clock.

    Returns values (K, 3) and valid (K,). A packet is valid between two finite poses at most `max_gap_s` apart, or
    exactly on one; nothing is extrapolated. Rows that are not valid are NaN. Poses may be unsorted; of poses with the
    same time the first counts; poses with a NaN are ignored.
    """
    times = np.asarray(t_s, float)
    pose_t, pose_v = _clean(np.asarray(pose_t_s, float), np.asarray(values, float))
    result = np.full((times.size, 3), np.nan)
    if pose_t.size == 0:
        return result, np.zeros(times.size, np.bool_)
    right = np.clip(np.searchsorted(pose_t, times, side="left"), 0, pose_t.size - 1)
    left = np.where(pose_t[right] == times, right, np.maximum(right - 1, 0))
    gap = pose_t[right] - pose_t[left]
    valid = (times >= pose_t[0]) & (times <= pose_t[-1]) & (gap <= max_gap_s)
    fraction = (times - pose_t[left]) / np.where(gap > 0, gap, 1.0)
    between = pose_v[left] + fraction[:, None] * (pose_v[right] - pose_v[left])
    result[valid] = between[valid]
    return result, valid


def antenna_positions(p_m: ArrayLike, q_wxyz: ArrayLike, lever_m: ArrayLike) -> Array:
    """Antenna positions p + R(q) l (N, 3) from body positions (N, 3), attitudes (N, 4) and the lever arm (3,), metres.

    The lever arm is the antenna seen from the tracked point, in body axes (forward, left, up).
    """
    return np.asarray(np.asarray(p_m, float) + rotate(q_wxyz, np.asarray(lever_m, float)))


def antenna_position(
    p_m: tuple[float, float, float], q_wxyz: tuple[float, float, float, float], lever_m: tuple[float, float, float]
) -> tuple[float, float, float]:
    """`antenna_positions` of a single body: a tenth of what arrays take for it."""
    w, x, y, z = q_wxyz
    a, b, c = lever_m
    # r x l, and r x (r x l)
    i, j, k = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        p_m[0] + (a + 2.0 * (w * i + (y * k - z * j))),
        p_m[1] + (b + 2.0 * (w * j + (z * i - x * k))),
        p_m[2] + (c + 2.0 * (w * k + (x * j - y * i))),
    )


def relative_displacement(
    p_i_m: ArrayLike, p_j_m: ArrayLike | None, reference: int | Literal["centroid"] = "centroid"
) -> Array:
    """chi (K, 3) in metres: (p_i - p_j) less its value at packet `reference`, or less its mean.

    p_i and p_j (K, 3) may have different origins, for these cancel, but must have the same axes. None: the other end
    stands still. The choice of reference turns every packet by the same phase and so leaves the profile unchanged.
    """
    apart = np.asarray(p_i_m, float)
    if p_j_m is not None:
        apart = apart - np.asarray(p_j_m, float)
    origin = apart.mean(axis=0) if reference == "centroid" else apart[reference]
    return np.asarray(apart - origin)


def _clean(t_s: Array, values: Array) -> tuple[Array, Array]:
    """Finite poses sorted by time, one per time."""
    finite = np.isfinite(t_s) & np.isfinite(values).all(axis=-1)
    unique_t, first = np.unique(t_s[finite], return_index=True)
    return unique_t, values[finite][first]
