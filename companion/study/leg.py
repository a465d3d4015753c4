"""A leg as a path in space: towards a target, wound into a helix so that the aperture is never flat.

A helix is what the Cramer-Rao bound asks for (paper, section on displacement geometries): it spreads the antenna over
all three axes, and at constant speed its curvature is constant, so a multicopter follows it closely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3

_POINTS = 241


@dataclass(frozen=True, slots=True)
class LegShape:
    """`length_m` of path with one turn about its axis; half-widths of the turn across and up; speed profile limits."""

    length_m: float
    lateral_m: float
    vertical_m: float
    speed_m_s: float
    acceleration_m_s2: float


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """Positions (N, 3) and velocities (N, 3) over times (N,) from the leg's start, in the local ENU frame."""

    t_s: npt.NDArray[np.float64]
    p_local_enu_m: npt.NDArray[np.float64]
    v_local_enu_m_s: npt.NDArray[np.float64]

    @property
    def duration_s(self) -> float:
        return float(self.t_s[-1])

    def at(self, t_s: float) -> tuple[Vector3, Vector3]:
        """Position and velocity `t_s` after the start; past the end it rests at the end."""
        px, py, pz = (float(np.interp(t_s, self.t_s, self.p_local_enu_m[:, axis])) for axis in range(3))
        if t_s >= self.duration_s:
            return (px, py, pz), (0.0, 0.0, 0.0)
        vx, vy, vz = (float(np.interp(t_s, self.t_s, self.v_local_enu_m_s[:, axis])) for axis in range(3))
        return (px, py, pz), (vx, vy, vz)


def plan_leg(start_m: Vector3, azimuth_rad: float, height_m: float, side: int, *, shape: LegShape) -> Leg:
    """One leg from `start_m` along `azimuth_rad` that ends at `height_m`. `side` (+1, -1) is where the helix swings
    first; alternating it keeps the flight on the line."""
    forward_m = _forward_length(shape)
    s = np.linspace(0.0, 1.0, _POINTS)
    along, across, up = _turn(s, forward_m, shape)
    axis = np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
    left = np.array([-axis[1], axis[0], 0.0])
    points = np.array(start_m) + np.outer(along, axis) + np.outer(side * across, left)
    points[:, 2] += up + s * (height_m - start_m[2])
    return _timed(points, shape)


def _turn(s: npt.NDArray[np.float64], forward_m: float, shape: LegShape) -> tuple[npt.NDArray[np.float64], ...]:
    """Along the axis, across it and up, over s in 0..1: one turn that returns to the axis."""
    angle = 2 * np.pi * s
    return forward_m * s, shape.lateral_m * (1 - np.cos(angle)), shape.vertical_m * np.sin(angle)


def _forward_length(shape: LegShape) -> float:
    """How far one leg advances when its path has the wanted length; 0 when the turn alone uses it up."""
    s = np.linspace(0.0, 1.0, _POINTS)

    def excess(forward_m: float) -> float:
        steps = np.diff(np.stack(_turn(s, forward_m, shape)), axis=1)
        return float(np.linalg.norm(steps, axis=0).sum()) - shape.length_m

    if excess(0.0) >= 0:
        return 0.0
    from scipy.optimize import brentq  # here: half a second of imports for all who only want another study

    return float(brentq(excess, 0.0, shape.length_m))


def _timed(points: npt.NDArray[np.float64], shape: LegShape) -> Leg:
    """Times along a path: from rest to rest, with limited acceleration and speed."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    total = distance[-1]
    top = min(shape.speed_m_s, math.sqrt(total * shape.acceleration_m_s2))
    ramp_s, ramp_m = top / shape.acceleration_m_s2, top**2 / (2 * shape.acceleration_m_s2)
    duration_s = 2 * ramp_s + (total - 2 * ramp_m) / top
    t_s = np.linspace(0.0, duration_s, _POINTS)
    left_s = duration_s - t_s
    travelled = np.where(
        t_s < ramp_s,
        shape.acceleration_m_s2 * t_s**2 / 2,
        np.where(left_s < ramp_s, total - shape.acceleration_m_s2 * left_s**2 / 2, ramp_m + top * (t_s - ramp_s)),
    )
    p_m = np.stack([np.interp(travelled, distance, points[:, axis]) for axis in range(3)], axis=1)
    return Leg(t_s, p_m, np.gradient(p_m, t_s, axis=0))
