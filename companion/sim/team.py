"""A team of robots that drive or fly about, each with drifting poses of its own, and the bearings they take of each
other. Radio is not simulated: a bearing errs as `companion.guidance` takes the bearings of apertures to err.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STEP_S: Final = 0.2
_AREA_M: Final = 9.0
"""Half the side of the square they move in."""
_APART_M: Final = 4.0
_HEIGHT_M: Final = (0.3, 2.5)
_SPEED_M_S: Final = 0.5
_BEARING_EVERY: Final = 0.5
_APERTURE_PARTS: Final = 5
"""An aperture spans so many periods of bearings, each with an error of its own: bearings overlap."""
_LATENCY_S: Final = 1.6
_RANGE_SHOWS_M: Final = 4.0
_AZIMUTH_STD_RAD: Final = math.radians(2.0)
_POLAR_STD_RAD: Final = math.radians(4.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamWorld:
    """`azimuth_model_rad`, `elevation_model_rad` and `inverse_range_std` come to a bearing's own deviations."""

    robots: int = 3
    duration_s: float = 120.0
    north_std_rad: float = math.radians(7.0)
    heading_walk_rad_sqrt_s: float = math.radians(0.3)
    drift_m_sqrt_m: float = 0.03 * math.sqrt(5.0)
    walk_m_sqrt_s: float = 0.02
    azimuth_model_rad: float = math.radians(6.0)
    elevation_model_rad: float = math.radians(12.0)
    inverse_range_std: float = 0.12
    turning_rad_s: float = 0.0
    """By which the axes of the last robot turn, from `turning_from_s` on for `turning_s`."""
    turning_from_s: float = 40.0
    turning_s: float = 60.0
    loss: float = 0.1
    """Of bearings on the way to the others."""
    observers: frozenset[int] | None = None
    """Who takes bearings; None for all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenRobot:
    """One bearing, `told_s` when the others know of it. Angles in the observer's own axes."""

    told_s: float
    t_s: float
    observer: int
    target: int
    number: int
    azimuth_rad: float
    azimuth_std_rad: float
    polar_rad: float
    polar_std_rad: float
    range_m: float | None
    range_std_m: float
    reliability: float
    fresh: float
    is_lost: bool
    """None but the observer itself has it."""


@dataclass(slots=True)
class Moment:
    """Truth and what is told at one time: places (N, 3), headings (N,) of the robots' own axes, own poses (N, 3)."""

    t_s: float
    places_m: Array
    headings_rad: Array
    poses_m: Array
    told: list[SeenRobot] = field(default_factory=list)


def moments(world: TeamWorld, rng: np.random.Generator) -> Iterator[Moment]:
    """Every `STEP_S`, in order."""
    n, steps = world.robots, round(world.duration_s / STEP_S) + 1
    places = _paths(n, steps, rng)
    headings = _headings(world, steps, rng)
    poses = _poses(world, places, headings, rng)
    seen = sorted(_bearings(world, places, headings, rng), key=lambda one: one.told_s)
    at = 0
    for k in range(steps):
        moment = Moment(k * STEP_S, places[k], headings[k], poses[k])
        while at < len(seen) and seen[at].told_s <= moment.t_s:
            moment.told.append(seen[at])
            at += 1
        yield moment


def _paths(n: int, steps: int, rng: np.random.Generator) -> Array:
    """(steps, n, 3) from one place to the next, straight at constant speed."""
    places = np.zeros((steps, n, 3))
    at = np.zeros((n, 3))
    for i in range(n):
        while True:
            at[i] = _somewhere(rng)
            if all(np.linalg.norm(at[i, :2] - at[j, :2]) > _APART_M for j in range(i)):
                break
    goals = np.array([_somewhere(rng) for _ in range(n)])
    for k in range(steps):
        places[k] = at
        for i in range(n):
            left = goals[i] - at[i]
            length = float(np.linalg.norm(left))
            if length < _SPEED_M_S * STEP_S:
                goals[i] = _somewhere(rng)
            else:
                at[i] = at[i] + left * (_SPEED_M_S * STEP_S / length)
    return places


def _somewhere(rng: np.random.Generator) -> Array:
    return np.array([*rng.uniform(-_AREA_M, _AREA_M, 2), rng.uniform(*_HEIGHT_M)])


def _headings(world: TeamWorld, steps: int, rng: np.random.Generator) -> Array:
    """(steps, n): of each robot's own axes against East and North."""
    walk = rng.normal(0.0, world.heading_walk_rad_sqrt_s * math.sqrt(STEP_S), (steps, world.robots))
    walk[0] = rng.normal(0.0, world.north_std_rad, world.robots)
    headings = np.cumsum(walk, axis=0)
    turning_s = np.clip(np.arange(steps) * STEP_S - world.turning_from_s, 0.0, world.turning_s)
    headings[:, -1] += world.turning_rad_s * turning_s
    return np.asarray(headings)


def _poses(world: TeamWorld, places: Array, headings: Array, rng: np.random.Generator) -> Array:
    """(steps, n, 3): each true step in the robot's own axes, and what drift adds."""
    true = np.diff(places, axis=0)
    length = np.linalg.norm(true, axis=2, keepdims=True)
    std = np.sqrt(world.drift_m_sqrt_m**2 * length + world.walk_m_sqrt_s**2 * STEP_S)
    said = true + rng.normal(size=true.shape) * std
    cos, sin = np.cos(headings[:-1]), np.sin(headings[:-1])
    x, y = said[..., 0].copy(), said[..., 1].copy()
    said[..., 0], said[..., 1] = cos * x + sin * y, cos * y - sin * x
    origin = rng.uniform(-50.0, 50.0, (1, world.robots, 3))
    return np.concatenate([origin, origin + np.cumsum(said, axis=0)])


def _bearings(world: TeamWorld, places: Array, headings: Array, rng: np.random.Generator) -> Iterator[SeenRobot]:
    every = round(_BEARING_EVERY / STEP_S * 2) / 2
    count = int((len(places) - 1) / every)
    fresh = 1.0 / _APERTURE_PARTS
    for i in range(world.robots):
        if world.observers is not None and i not in world.observers:
            continue
        for j in range(world.robots):
            if j == i:
                continue
            azimuth_std = math.hypot(_AZIMUTH_STD_RAD, world.azimuth_model_rad)
            polar_std = math.hypot(_POLAR_STD_RAD, world.elevation_model_rad)
            errors = _overlapping(rng, count, 3)
            blocks = count // _APERTURE_PARTS + 1
            reliability = np.repeat(rng.uniform(0.2, 1.0, blocks), _APERTURE_PARTS)
            direct = np.repeat(rng.uniform(size=blocks), _APERTURE_PARTS) < 0.45 + 0.4 * reliability
            image = np.repeat(rng.uniform(-math.pi, math.pi, blocks), _APERTURE_PARTS)
            tilt = np.repeat(rng.uniform(-1.0, 1.0, blocks), _APERTURE_PARTS)
            for m in range(count):
                k = int(m * every)
                v = places[k, j] - places[k, i]
                flat = math.hypot(v[0], v[1])
                azimuth, elevation = math.atan2(v[1], v[0]), math.atan2(v[2], flat)
                if direct[m]:
                    azimuth += azimuth_std * errors[m, 0]
                    elevation += polar_std * errors[m, 1]
                else:
                    azimuth, elevation = image[m], tilt[m]
                range_m, range_std_m = None, math.inf
                true_m = float(np.linalg.norm(v))
                inverse = 1 / true_m + world.inverse_range_std * errors[m, 2]
                if direct[m] and true_m < _RANGE_SHOWS_M and inverse > 0.02:
                    range_m = 1 / inverse
                    range_std_m = 0.02 * range_m**2
                yield SeenRobot(
                    told_s=k * STEP_S + _LATENCY_S,
                    t_s=k * STEP_S,
                    observer=i,
                    target=j,
                    number=m,
                    azimuth_rad=math.remainder(azimuth - headings[k, i], math.tau),
                    azimuth_std_rad=_AZIMUTH_STD_RAD,
                    polar_rad=math.pi / 2 - elevation,
                    polar_std_rad=_POLAR_STD_RAD,
                    range_m=range_m,
                    range_std_m=range_std_m,
                    reliability=float(reliability[m]),
                    fresh=1.0 if m == 0 else fresh,
                    is_lost=bool(rng.uniform() < world.loss),
                )


def _overlapping(rng: np.random.Generator, count: int, columns: int) -> Array:
    """(count, columns) errors of deviation 1, each the mean of what its aperture's parts have."""
    parts = rng.normal(0.0, math.sqrt(_APERTURE_PARTS), (count + _APERTURE_PARTS, columns))
    total = np.cumsum(parts, axis=0)
    return np.asarray((total[_APERTURE_PARTS:] - total[:-_APERTURE_PARTS]) / _APERTURE_PARTS)
