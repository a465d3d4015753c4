"""Paths of equal length for the studies, sampled at equal steps of their length."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from wsr.geometry import direction

Array = npt.NDArray[np.float64]

_FINE = 20_001


def resample(points_m: Array, count: int) -> Array:
    """`count` positions (count, 3) at equal steps along a fine polyline (N, 3), both ends included."""
    steps = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, s[-1], count)
    return np.stack([np.interp(at, s, points_m[:, axis]) for axis in range(3)], axis=1)


def scaled_to(points_m: Array, length_m: float) -> Array:
    """The same shape with the wanted length."""
    return np.asarray(points_m * (length_m / np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum()))


def spherical_helix(length_m: float, count: int, turns: float = 1.0) -> Array:
    """The paper's helix: polar angle t, azimuth `turns` t, t in [0, 2 pi), on a sphere. Equal steps of length."""
    t = np.linspace(0.0, 2 * math.pi, _FINE)
    return resample(scaled_to(direction(turns * t, t), length_m), count)


def climbing_helix(length_m: float, count: int, turns: float = 1.0, pitch: float = 0.5) -> Array:
    """A helix about the vertical; `pitch` is the climb over the horizontal way."""
    t = np.linspace(0.0, 2 * math.pi * turns, _FINE)
    return resample(scaled_to(np.stack([np.cos(t), np.sin(t), pitch * t], axis=1), length_m), count)


def circle(length_m: float, count: int, turns: float = 1.0) -> Array:
    """A horizontal circle, or part of one."""
    t = np.linspace(0.0, 2 * math.pi * turns, _FINE)
    return resample(scaled_to(np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=1), length_m), count)


def line(length_m: float, count: int, azimuth_rad: float = 0.0, polar_rad: float = math.pi / 2) -> Array:
    """Straight, from the origin."""
    return np.asarray(np.linspace(0.0, length_m, count)[:, None] * direction(azimuth_rad, polar_rad))


def wander(rng: np.random.Generator, length_m: float, count: int, planar: bool) -> Array:
    """An arbitrary smooth path: three seeded harmonics in each axis, the height left out in a plane."""
    t = np.linspace(0.0, 1.0, _FINE)
    points = np.zeros((_FINE, 3))
    for axis in range(2 if planar else 3):
        for harmonic in (0.5, 1.0, 1.5):
            phase = rng.uniform(-math.pi, math.pi)
            points[:, axis] += rng.normal() / harmonic * np.sin(2 * math.pi * harmonic * t + phase)
    return resample(scaled_to(points, length_m), count)
