"""What is believed of a target: the likeliest source, its rivals, and what the whole belief says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.guidance.modes import densest
from companion.sensing.records import Bearing
from wsr.aoa import Matrix3

_Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rival:
    """Another place that may be the target's, as the origin of its frame, with its probability."""

    origin_local_enu_m: Vector3
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeBelief:
    """Of the whole belief, all sources counted: what a mean and a deviation of one source cannot say."""

    origin_local_enu_m: Vector3
    covariance_m2: Matrix3
    range_90_m: tuple[float, float]
    """Nearer and farther than these it is with 5 % each."""
    direction_90_rad: float
    """With 90 % its direction is so near to that of the likeliest source."""


@dataclass(frozen=True, slots=True, eq=False)
class Scatter:
    """A few places of a belief, each as likely as the others."""

    p_local_enu_m: _Floats
    """(N, 3) of the target, at its newest bearing."""
    heading_rad: _Floats
    """(N,) by which all its bearings are off, if it is there; and so by elevation:"""
    elevation_rad: _Floats
    rooms: _Floats
    """(K,) probability of each kind of room."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Where the target is thought to be, seen from the newest bearing's place."""

    t_mono_ns: int
    azimuth_rad: float
    origin_local_enu_m: Vector3
    """Mean of the origin of the target's own poses in the autopilot's local frame, of the likeliest source."""
    covariance_m2: Matrix3
    boot: int
    range_m: float
    range_std_m: float
    probability: float
    """Of that source."""
    whole: WholeBelief
    rivals: tuple[Rival, ...] = ()

    def place(self, target_p_enu_m: Vector3) -> Vector3:
        """Where the target is in the autopilot's local frame when its own poses say `target_p_enu_m`."""
        x, y, z = (o + q for o, q in zip(self.origin_local_enu_m, target_p_enu_m, strict=True))
        return x, y, z


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetReport:
    """What a new bearing made of the target, for the log."""

    t_mono_ns: int
    peer: int
    iteration: int
    target: Target
    p_local_enu_m: Vector3
    """Where the target was when the bearing was taken."""


def of_places(origins_m: _Floats, weight: _Floats, newest: Bearing) -> Target:
    """What places (N, 3) of the origin with weights (N,), which come to one, say after the newest bearing."""
    here_m = np.subtract(newest.p_local_enu_m, newest.target_p_enu_m)
    left, found = weight.copy(), list[tuple[float, npt.NDArray[np.intp]]]()
    for _ in range(3):
        members = densest(origins_m - here_m, left)
        found.append((float(left[members].sum()), members))
        left[members] = 0.0
        if left.sum() < 0.05:
            break
    found.sort(key=lambda mode: -mode[0])
    probability, members = found[0]
    mean_m, covariance = moments(origins_m[members], weight[members])
    offset_m = mean_m - here_m
    range_m = float(np.linalg.norm(offset_m))
    along = offset_m / max(range_m, 1e-9)
    rivals = [Rival(vector(moments(origins_m[m], weight[m])[0]), p) for p, m in found[1:] if p > 0.02]
    return Target(
        t_mono_ns=newest.t_mono_ns,
        azimuth_rad=math.atan2(offset_m[1], offset_m[0]),
        origin_local_enu_m=vector(mean_m),
        covariance_m2=(vector(covariance[0]), vector(covariance[1]), vector(covariance[2])),
        boot=newest.target_boot,
        range_m=range_m,
        range_std_m=math.sqrt(float(along @ covariance @ along)),
        probability=min(1.0, probability),
        whole=whole_belief(origins_m, weight, here_m, along),
        rivals=tuple(rivals),
    )


def whole_belief(origins_m: _Floats, weight: _Floats, here_m: _Floats, along: _Floats) -> WholeBelief:
    """Of particles (N, 3) with weights (N,), seen from `here_m` (3,). `along` (3,) is the direction of the likeliest
    source."""
    mean_m, covariance = moments(origins_m, weight)
    offsets_m = origins_m - here_m
    range_m = np.linalg.norm(offsets_m, axis=1)
    cosine = np.einsum("nx,x->n", offsets_m, along) / np.maximum(range_m, 1e-9)
    nearest, farthest = _quantiles(range_m, weight, (0.05, 0.95))
    (least_cosine,) = _quantiles(cosine, weight, (0.1,))
    return WholeBelief(
        origin_local_enu_m=vector(mean_m),
        covariance_m2=(vector(covariance[0]), vector(covariance[1]), vector(covariance[2])),
        range_90_m=(nearest, farthest),
        direction_90_rad=math.acos(max(-1.0, min(1.0, least_cosine))),
    )


def _quantiles(values: _Floats, weight: _Floats, shares: tuple[float, ...]) -> list[float]:
    """Of values (N,) with weights (N,)."""
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    at = np.searchsorted(below, np.array(shares) * below[-1])
    return [float(value) for value in values[order[np.minimum(at, len(order) - 1)]]]


def moments(points_m: _Floats, weight: _Floats) -> tuple[_Floats, _Floats]:
    """Mean (3,) and covariance (3, 3)."""
    share = weight / weight.sum()
    mean_m = share @ points_m
    centred = points_m - mean_m
    return mean_m, np.asarray((share[:, None] * centred).T @ centred)


def vector(values: npt.NDArray[Any]) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z
