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
_DRIFT_M_S = 0.02  # how fast the poses of the two robots part from the truth: 1.5 % of walking pace each
_ITERATIONS = 4


@dataclass(frozen=True, slots=True)
class Bearing:
    """One direction to a target: from `p_local_enu_m` along azimuth and polar angle, at `t_mono_ns`.

    `target_p_enu_m` is where the target then was by its own poses: in North-aligned axes about an origin of its own,
    which lasts as long as its boot `target_boot`.
    """

    t_mono_ns: int
    p_local_enu_m: Vector3
    azimuth_rad: float
    polar_rad: float
    azimuth_std_rad: float
    polar_std_rad: float
    """Infinite where the aperture did not tell the polar angle: then the bearing is a half plane."""
    target_p_enu_m: Vector3
    target_boot: int

    def axes(self) -> _Array:
        """Unit vectors (3, 3), one a row: to the target, with rising azimuth, with rising polar angle."""
        sin_a, cos_a = math.sin(self.azimuth_rad), math.cos(self.azimuth_rad)
        sin_p, cos_p = math.sin(self.polar_rad), math.cos(self.polar_rad)
        return np.array(
            [[sin_p * cos_a, sin_p * sin_a, cos_p], [-sin_a, cos_a, 0.0], [cos_p * cos_a, cos_p * sin_a, -sin_p]]
        )


@dataclass(frozen=True, slots=True)
class Target:
    """Where the target is thought to be. `range_m` is from the newest bearing's place; its deviation is infinite while
    the bearings do not cross."""

    t_mono_ns: int
    azimuth_rad: float
    origin_local_enu_m: Vector3 | None
    """Origin of the target's own poses in the autopilot's local frame; None while the bearings do not cross."""
    boot: int
    range_m: float
    range_std_m: float

    def range_from(self, p_local_enu_m: Vector3, target_p_enu_m: Vector3) -> float:
        """Range [m] from a place to the target where its own poses say it is now; infinite where unknown."""
        if self.origin_local_enu_m is None:
            return math.inf
        now_m = (o + q for o, q in zip(self.origin_local_enu_m, target_p_enu_m, strict=True))
        return math.dist(p_local_enu_m, tuple(now_m))


@dataclass(frozen=True, slots=True)
class TargetReport:
    """What a new bearing made of the target, for the log."""

    t_mono_ns: int
    peer: int
    iteration: int
    target: Target
    p_local_enu_m: Vector3 | None
    """Where the target was when the bearing was taken; None while the bearings do not cross."""


class TargetTracker:
    """Keeps the newest bearings to one target and triangulates.

    The target may drive: it shares its own poses, so what is unknown, and the same for all bearings, is the origin of
    its frame in ours. Taken for standing, a target that drives across the line of sight would seem nearer than it is.
    """

    def __init__(self) -> None:
        self._bearings: deque[Bearing] = deque(maxlen=_KEPT)

    def add(self, bearing: Bearing) -> Target:
        """Takes the newest bearing. One of another boot of the target has another origin: older ones are forgotten."""
        if self._bearings and self._bearings[-1].target_boot != bearing.target_boot:
            self._bearings.clear()
        self._bearings.append(bearing)
        return self.target()

    def target(self) -> Target:
        """The newest bearing with the range at which it crosses the older ones. Raises IndexError without bearings."""
        newest = self._bearings[-1]
        solution = _triangulate(list(self._bearings)) if len(self._bearings) > 1 else None
        if solution is None:
            return Target(newest.t_mono_ns, newest.azimuth_rad, None, newest.target_boot, math.inf, math.inf)
        origin, covariance = solution
        offset = origin - _place(newest)
        range_m = float(np.linalg.norm(offset))
        along = offset / max(range_m, 1e-9)
        x, y, z = origin.tolist()
        std_m = math.sqrt(max(0.0, float(along @ covariance @ along)))
        return Target(newest.t_mono_ns, newest.azimuth_rad, (x, y, z), newest.target_boot, range_m, std_m)


def _place(bearing: Bearing) -> _Array:
    """Where a bearing was taken (3,), relative to the target's motion: from here it points to the common origin."""
    return np.asarray(np.subtract(bearing.p_local_enu_m, bearing.target_p_enu_m))


def _triangulate(
    bearings: list[Bearing],
) -> tuple[_Array, _Array] | None:
    """Least squares of the distances from the lines, each weighted by what its angle is worth at that range: the
    target's origin (3,) and covariance (3, 3), or None when the lines are parallel or cross behind the newest."""
    newest = bearings[-1]
    position: _Array = _place(newest) + 5.0 * newest.axes()[0]
    covariance: _Array = np.zeros((3, 3))
    for _ in range(_ITERATIONS):
        information: _Array = np.zeros((3, 3))
        moment: _Array = np.zeros(3)
        for bearing in bearings:
            place = _place(bearing)
            age_s = (newest.t_mono_ns - bearing.t_mono_ns) / 1e9
            range_m = max(0.5, float(np.linalg.norm(position - place)))
            sideways = bearing.axes()[1:]
            std_rad = (math.sin(bearing.polar_rad) * bearing.azimuth_std_rad, bearing.polar_std_rad)
            std_m = [math.hypot(range_m * math.hypot(std, _FLOOR_RAD), _DRIFT_M_S * age_s) for std in std_rad]
            across = sideways.T @ np.diag(np.power(std_m, -2.0)) @ sideways
            information += across
            moment += across @ place
        if np.linalg.cond(information) > 1e8:
            return None
        covariance = np.asarray(np.linalg.inv(information))
        position = np.asarray(covariance @ moment)
    ahead = float((position - _place(newest)) @ newest.axes()[0])
    return (position, covariance) if ahead > 0 else None
