"""Bearings from several places -> where the target is, and how sure that is."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.messages import Vector3

_Array = npt.NDArray[np.float64]
_KEPT = 8
_FLOOR_RAD = math.radians(6.0)  # pose drift, reflections and, near the target, curvature: no bound on noise knows them
_TARGET_SPEED_M_S = 0.1  # how fast an unseen target may have moved since an old bearing
_ITERATIONS = 4


@dataclass(frozen=True, slots=True)
class Bearing:
    """One direction to a target: from `p_local_enu_m` along azimuth and polar angle, at `t_mono_ns`."""

    t_mono_ns: int
    p_local_enu_m: Vector3
    azimuth_rad: float
    polar_rad: float
    std_rad: float

    def unit(self) -> _Array:
        sin_polar = math.sin(self.polar_rad)
        return np.array(
            [sin_polar * math.cos(self.azimuth_rad), sin_polar * math.sin(self.azimuth_rad), math.cos(self.polar_rad)]
        )


@dataclass(frozen=True, slots=True)
class Target:
    """Where the target is thought to be. `range_m` is from the newest bearing's place; its deviation is infinite while
    the bearings do not cross."""

    t_mono_ns: int
    azimuth_rad: float
    p_local_enu_m: Vector3 | None
    range_m: float
    range_std_m: float


class TargetTracker:
    """Keeps the newest bearings to one target and triangulates."""

    def __init__(self) -> None:
        self._bearings: deque[Bearing] = deque(maxlen=_KEPT)

    def add(self, bearing: Bearing) -> Target:
        self._bearings.append(bearing)
        return self.target()

    def target(self) -> Target:
        """The newest bearing with the range at which it crosses the older ones. Raises IndexError without bearings."""
        newest = self._bearings[-1]
        solution = _triangulate(list(self._bearings)) if len(self._bearings) > 1 else None
        if solution is None:
            return Target(newest.t_mono_ns, newest.azimuth_rad, None, math.inf, math.inf)
        position, covariance = solution
        offset = position - np.array(newest.p_local_enu_m)
        range_m = float(np.linalg.norm(offset))
        along = offset / max(range_m, 1e-9)
        x, y, z = position.tolist()
        std_m = math.sqrt(max(0.0, float(along @ covariance @ along)))
        return Target(newest.t_mono_ns, newest.azimuth_rad, (x, y, z), range_m, std_m)


def _triangulate(
    bearings: list[Bearing],
) -> tuple[_Array, _Array] | None:
    """Least squares of the distances from the lines, each weighted by what its angle is worth at that range: position
    (3,) and covariance (3, 3), or None when the lines are parallel or cross behind the newest."""
    newest = bearings[-1]
    position: _Array = np.array(newest.p_local_enu_m) + 5.0 * newest.unit()
    covariance: _Array = np.zeros((3, 3))
    for _ in range(_ITERATIONS):
        information: _Array = np.zeros((3, 3))
        moment: _Array = np.zeros(3)
        for bearing in bearings:
            origin, unit = np.array(bearing.p_local_enu_m), bearing.unit()
            age_s = (newest.t_mono_ns - bearing.t_mono_ns) / 1e9
            range_m = max(0.5, float(np.linalg.norm(position - origin)))
            std_m = math.hypot(range_m * math.hypot(bearing.std_rad, _FLOOR_RAD), _TARGET_SPEED_M_S * age_s)
            across = (np.eye(3) - np.outer(unit, unit)) / std_m**2
            information += across
            moment += across @ origin
        if np.linalg.cond(information) > 1e8:
            return None
        covariance = np.asarray(np.linalg.inv(information))
        position = np.asarray(covariance @ moment)
    ahead = float((position - np.array(newest.p_local_enu_m)) @ newest.unit())
    return (position, covariance) if ahead > 0 else None
