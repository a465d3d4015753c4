"""What sightings say of the robots' places and headings: residuals, Jacobians and weights of all of them at once.

A state is (..., 4): place [m] in axes that point East, North and Up, and the heading of the robot's own axes against
those [rad], counter-clockwise. Robot i at p_i with heading h_i sees robot j at v = p_j + R(h_j) d_j - p_i - R(h_i) d_i,
where d is the way since the keyframe by the robot's own poses: azimuth atan2(v_y, v_x) - h_i, elevation, 1 / range.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

AZIMUTH_STD_RAD: Final = math.radians(6.0)
ELEVATION_STD_RAD: Final = math.radians(12.0)
INVERSE_RANGE_STD: Final = 0.12
"""[1/m]; beside a sighting's own deviations, as the tracker has them (docs/guidance.md): reflections pull, floor and
ceiling mirror, drift bends the wave front."""
_DIRECT: Final = 0.45, 0.4
"""Probability that a reported path is the direct one: this, and so much more with reliability 1."""
_RANGE_TRUSTED: Final = 0.8
_ANYWHERE: Final = 1 / math.tau, 0.5, 0.5
"""Densities of azimuth [1/rad], elevation [1/rad] and inverse range [m] where the path is another one."""
_NEAREST_M: Final = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Sightings:
    """M sightings: keyframe, observer and target as indices, ways (M, 3) of both since the keyframe in their own axes,
    measured azimuth, elevation and 1 / range with their deviations (infinite where not observed), reliability, and the
    share of packets that no other sighting has."""

    keyframe: Index
    observer: Index
    target: Index
    observer_way_m: Array
    target_way_m: Array
    measured: Array
    """(M, 3)"""
    std: Array
    """(M, 3)"""
    reliability: Array
    fresh: Array

    def __len__(self) -> int:
        return len(self.keyframe)


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """`residual` (M, 3), `jacobian` (M, 3, 8) by observer's and target's states, `information` (M, 3), the probability
    `direct` (M,) that it is the direct path, `cost`."""

    residual: Array
    jacobian: Array
    information: Array
    direct: Array
    cost: float


def trusted(reliability: Array) -> Array:
    """Probability that a reported path is the direct one, before anything else is known."""
    return _DIRECT[0] + _DIRECT[1] * reliability


def look(states: Array, sightings: Sightings) -> Seen:
    """Of states (K, N, 4)."""
    own, other = (states[sightings.keyframe, who] for who in (sightings.observer, sightings.target))
    own_way_m, own_turn = _turned(sightings.observer_way_m, own[:, 3])
    other_way_m, other_turn = _turned(sightings.target_way_m, other[:, 3])
    v = other[:, :3] + other_way_m - own[:, :3] - own_way_m
    flat_m = np.maximum(np.hypot(v[:, 0], v[:, 1]), _NEAREST_M)
    range_m = np.hypot(flat_m, v[:, 2])
    azimuth = np.arctan2(v[:, 1], v[:, 0]) - own[:, 3]
    foreseen = np.stack([azimuth, np.arctan2(v[:, 2], flat_m), 1 / range_m], axis=1)
    residual = foreseen - sightings.measured
    residual[:, 0] = (residual[:, 0] + math.pi) % math.tau - math.pi
    residual[~np.isfinite(sightings.std)] = 0.0
    by_v = np.zeros((len(v), 3, 3))
    by_v[:, 0, 0], by_v[:, 0, 1] = -v[:, 1] / flat_m**2, v[:, 0] / flat_m**2
    by_v[:, 1, 0] = -v[:, 0] * v[:, 2] / (flat_m * range_m**2)
    by_v[:, 1, 1] = -v[:, 1] * v[:, 2] / (flat_m * range_m**2)
    by_v[:, 1, 2] = flat_m / range_m**2
    by_v[:, 2] = -v / range_m[:, None] ** 3
    jacobian = np.zeros((len(v), 3, 8))
    jacobian[:, :, 0:3], jacobian[:, :, 4:7] = -by_v, by_v
    jacobian[:, :, 3] = -np.einsum("mij,mj->mi", by_v, own_turn)
    jacobian[:, 0, 3] -= 1.0
    jacobian[:, :, 7] = np.einsum("mij,mj->mi", by_v, other_turn)
    information, direct, cost = _weighed(residual, sightings)
    return Seen(residual=residual, jacobian=jacobian, information=information, direct=direct, cost=cost)


def _weighed(residual: Array, sightings: Sightings) -> tuple[Array, Array, float]:
    """Each is the direct path, or another one whose direction says nothing: the weight is the probability of the first,
    given what is known (EM: each step with it lowers the cost). Packets counted before do not count again."""
    seen = np.isfinite(sightings.std)
    std = np.where(seen, sightings.std, 1.0)
    squared = (residual / std) ** 2
    density = np.where(seen, np.exp(-0.5 * squared) / (std * math.sqrt(math.tau)), 1.0)
    anywhere = np.where(seen, _ANYWHERE, 1.0)
    before = trusted(sightings.reliability)
    hit, miss = before * density[:, 0] * density[:, 1], (1 - before) * anywhere[:, 0] * anywhere[:, 1]
    range_hit, range_miss = _RANGE_TRUSTED * density[:, 2], (1 - _RANGE_TRUSTED) * anywhere[:, 2]
    by_range = np.where(seen[:, 2], range_hit + range_miss, 1.0)
    hit = hit * by_range
    miss = miss * anywhere[:, 2]
    total = np.maximum(hit + miss, 1e-300)
    direct = hit / total
    weight = np.repeat(direct[:, None], 3, axis=1)
    weight[:, 2] *= np.where(seen[:, 2], range_hit / np.maximum(by_range, 1e-300), 0.0)
    information = np.where(seen, sightings.fresh[:, None] * weight / std**2, 0.0)
    return information, direct, -float(sightings.fresh @ np.log(total))


def _turned(way_m: Array, heading_rad: Array) -> tuple[Array, Array]:
    """Ways (M, 3) turned by headings (M,), and their derivative by heading."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    x, y = way_m[:, 0], way_m[:, 1]
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, way_m[:, 2]], axis=1)
    return turned, np.stack([-turned[:, 1], turned[:, 0], np.zeros(len(way_m))], axis=1)
