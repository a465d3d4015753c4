"""Bearings from several places -> where the target is, and how sure that is.

The posterior over a grid of places about the newest bearing's own, not a least squares of lines: bearings along one
line of flight do not tell the range, and least squares then finds a place beside the vehicle as readily as one far
away, with a small deviation there. A bearing may also be wrong altogether (a reflection): each is a mixture of itself
and of nothing, by its reliability, so that one that disagrees with the others is outvoted.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.sensing.records import Bearing

_Floats = npt.NDArray[np.floating[Any]]
_KEPT: Final = 8
_FLOOR_RAD: Final = math.radians(6.0)
"""Pose drift, reflections and, near the target, curvature: no bound on noise knows them."""
_DRIFT_M_S: Final = 0.02
"""How fast the poses of the two robots part from the truth: 1.5 % of walking pace each."""
_MOST_TRUSTED: Final = 0.9
"""The share of bearings of reliability 1 that are of the direct path."""
_REACH_M: Final = 40.0
"""Targets are looked for up to here: radio does not reach much farther indoors."""
_NEAREST_M: Final = 0.4
_ONE_MODE_RAD: Final = math.radians(18.0)
"""Places within this angle of the most likely one are the same target; others are rivals."""
_STEP_RAD: Final = math.radians(7.5)
_REFINEMENTS: Final = 4


@dataclass(frozen=True, slots=True)
class Target:
    """Where the target is thought to be: azimuth from the newest bearing's place, and the range, whose deviation is of
    the whole posterior: it is large while the bearings do not cross, or do not agree. Both are infinite for one."""

    t_mono_ns: int
    azimuth_rad: float
    origin_local_enu_m: Vector3 | None
    """Origin of the target's own poses in the autopilot's local frame; None before there are two bearings."""
    boot: int
    range_m: float
    range_std_m: float
    agreement: float = 0.0
    """Share of the bearings kept that point there, in 0..1: where it is low, no place explains what was measured."""

    def place(self, target_p_enu_m: Vector3) -> Vector3 | None:
        """Where the target is in the autopilot's local frame when its own poses say `target_p_enu_m`; None before there
        are two bearings."""
        if self.origin_local_enu_m is None:
            return None
        x, y, z = (o + q for o, q in zip(self.origin_local_enu_m, target_p_enu_m, strict=True))
        return x, y, z


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
    """Keeps the newest bearings to one target and locates it.

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

    def shift(self, delta_enu_m: Vector3) -> None:
        """All places where bearings were taken are `delta_enu_m` elsewhere."""
        for index, bearing in enumerate(self._bearings):
            x, y, z = (p + d for p, d in zip(bearing.p_local_enu_m, delta_enu_m, strict=True))
            self._bearings[index] = dataclasses.replace(bearing, p_local_enu_m=(x, y, z))

    def target(self) -> Target:
        """What all bearings together say. Raises IndexError without bearings. Takes some milliseconds."""
        newest = self._bearings[-1]
        if len(self._bearings) == 1:
            return Target(newest.t_mono_ns, newest.azimuth_rad, None, newest.target_boot, math.inf, math.inf)
        weight = _posterior(list(self._bearings))
        mode = _UNITS @ _UNITS[int(np.argmax(weight.sum(axis=1)))] > math.cos(_ONE_MODE_RAD)
        in_mode = weight * mode[:, None]
        # The median, since the far end of a range that is hardly known weighs most in a mean.
        share = np.cumsum(in_mode.sum(axis=0)) / in_mode.sum()
        range_m = float(np.exp(np.interp(0.5, share, np.log(_RANGES_M))))
        towards = in_mode.sum(axis=1) @ _UNITS
        offset = _refined(list(self._bearings), range_m * towards / np.linalg.norm(towards))
        # Rivals in other directions count: while they live the range is not known.
        std_m = math.sqrt(float(weight.sum(axis=0) @ (_RANGES_M - range_m) ** 2))
        x, y, z = (_place(newest) + offset).tolist()
        azimuth_rad = math.atan2(offset[1], offset[0])
        agreement = float(np.mean(_goodness(list(self._bearings), offset)))
        return Target(newest.t_mono_ns, azimuth_rad, (x, y, z), newest.target_boot, range_m, std_m, agreement)


def _place(bearing: Bearing) -> _Floats:
    """Where a bearing was taken (3,), relative to the target's motion: from here it points to the common origin."""
    return np.asarray(np.subtract(bearing.p_local_enu_m, bearing.target_p_enu_m))


def _grid() -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Unit vectors (D, 3) of equal steps, ranges (R,) in equal ratios, and the prior weights of both."""
    polar = np.arange(_STEP_RAD * 2.5, math.pi - _STEP_RAD * 2, _STEP_RAD)
    azimuth = np.arange(-math.pi, math.pi - 1e-9, _STEP_RAD)
    p, a = (grid.ravel() for grid in np.meshgrid(polar, azimuth, indexing="ij"))
    units = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=1)
    ranges_m = np.geomspace(_NEAREST_M, _REACH_M, 20)
    # Along a line of sight every metre is as likely, and the steps grow with the range.
    return tuple(values.astype(np.float32) for values in (units, ranges_m, np.sin(p), ranges_m))  # type: ignore[return-value]


_UNITS, _RANGES_M, _UNIT_PRIOR, _RANGE_PRIOR = _grid()
_OFFSETS = _UNITS[:, None, :] * _RANGES_M[:, None]


def _posterior(bearings: list[Bearing]) -> _Floats:
    """Probability (D, R) of each direction and range from the newest bearing's place; they sum to 1."""
    newest = bearings[-1]
    log_weight = np.log(_UNIT_PRIOR)[:, None] + np.log(_RANGE_PRIOR)
    for bearing in bearings:
        moved = (_place(newest) - _place(bearing)).astype(np.float32)
        log_weight = log_weight + np.log(_Misfit.of(bearing, _OFFSETS + moved, newest).density(bearing))
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


@dataclass(frozen=True, slots=True, eq=False)
class _Misfit:
    """By how much a bearing misses targets (...,): angles across and down, their variances, and the ranges."""

    across_rad: _Floats
    down_rad: _Floats
    across_var: _Floats
    down_var: _Floats
    range_m: _Floats

    @staticmethod
    def of(bearing: Bearing, offsets: _Floats, newest: Bearing) -> _Misfit:
        """For targets at `offsets` (..., 3) from the bearing's place."""
        flat = np.hypot(offsets[..., 0], offsets[..., 1])
        range_m = np.maximum(np.hypot(flat, offsets[..., 2]), np.float32(_NEAREST_M))
        azimuth = bearing.azimuth_rad - np.arctan2(offsets[..., 1], offsets[..., 0])
        azimuth -= math.tau * np.round(azimuth / math.tau)
        down = bearing.polar_rad - np.arctan2(flat, offsets[..., 2])
        drift_rad = _DRIFT_M_S * (newest.t_mono_ns - bearing.t_mono_ns) / 1e9 / range_m
        least = _FLOOR_RAD**2 + drift_rad**2
        # At the pole an azimuth means nothing: what it says across shrinks with the sine.
        sine = flat / range_m
        return _Misfit(
            sine * azimuth,
            down,
            (sine * bearing.azimuth_std_rad) ** 2 + least,
            bearing.polar_std_rad**2 + least,
            range_m,
        )

    def density(self, bearing: Bearing) -> _Floats:
        """Of the bearing, per steradian: a mixture of a good one and of one that says nothing."""
        trusted = _MOST_TRUSTED * bearing.reliability
        return trusted * self._good() + (1.0 - trusted) / (4.0 * math.pi)

    def goodness(self, bearing: Bearing) -> float:
        """Probability that the bearing is a good one, for one target."""
        good = _MOST_TRUSTED * bearing.reliability * self._good()
        return float(good / self.density(bearing))

    def _good(self) -> _Floats:
        across = np.exp(-0.5 * self.across_rad**2 / self.across_var) / np.sqrt(math.tau * self.across_var)
        if np.isinf(self.down_var).any():
            return np.asarray(across / math.pi)
        down = np.exp(-0.5 * self.down_rad**2 / self.down_var) / np.sqrt(math.tau * self.down_var)
        return np.asarray(across * down)


def _goodness(bearings: list[Bearing], offset: _Floats) -> list[float]:
    """Of each bearing: the probability that it is of a target at `offset` (3,) from the newest's place."""
    here = offset + _place(bearings[-1])
    return [_Misfit.of(b, here - _place(b), bearings[-1]).goodness(b) for b in bearings]


def _refined(bearings: list[Bearing], offset: _Floats) -> _Floats:
    """The offset (3,) from the newest place turned, at its range, to where the bearings that agree with it point."""
    newest = bearings[-1]
    offset = offset.astype(np.float64)
    for _ in range(_REFINEMENTS):
        range_m, flat_m = float(np.linalg.norm(offset)), max(math.hypot(offset[0], offset[1]), 1e-6)
        left = np.array([-offset[1], offset[0], 0.0]) / flat_m
        down = np.array([offset[0] * offset[2] / flat_m, offset[1] * offset[2] / flat_m, -flat_m]) / range_m
        turn, weight = np.zeros(2), np.full(2, 1e-12)
        for bearing in bearings:
            misfit = _Misfit.of(bearing, offset + _place(newest) - _place(bearing), newest)
            # A turn seen from here is less of a turn seen from farther away.
            lever = range_m / float(misfit.range_m)
            each = lever * misfit.goodness(bearing) / np.array([misfit.across_var, misfit.down_var])
            turn += each * np.array([misfit.across_rad, misfit.down_rad])
            weight += each * lever
        step = turn / weight
        offset = offset + range_m * (step[0] * left + step[1] * down)
        offset *= range_m / np.linalg.norm(offset)
    return offset
