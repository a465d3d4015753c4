"""Which of a few ways to fly: the one with the least time to the target and to the knowledge that arrival needs.

Bearings from one line do not cross, and a flat aperture shows neither range nor height; but whoever weaves comes late.
Both are weighed in seconds. For each way it is predicted what its apertures would tell two places of the belief apart
by, whichever of them is the target's: with deviations by the Cramer-Rao bound of the aperture's extent across the line
of sight, and the floor of the kind of room. What places are then still apart, on the average, costs its flight. Pure.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.guidance.likelihood import CURVATURE_SCALE, CURVATURE_STD_PER_M, is_afar
from companion.guidance.reach import Reach
from companion.guidance.regimes import REGIMES
from companion.guidance.target import Scatter
from companion.safety.gate import GateLimits

_Floats = npt.NDArray[np.float64]

PLACES: Final = 20
_WEAVE_GAIN: Final = 1.3
"""The weave is wished for that much wider than it is flown."""
_LEADS_RAD: Final = tuple(math.radians(angle) for angle in (10.0, 20.0, 30.0, 45.0))
_WEAVES: Final = (0.4, 0.5, 1.0)
"""A thinner one is nearly end-fire: half a second quicker over 15 m, and its bearings are off by 1.3 degrees more."""
_LOOKS: Final = 5
"""A way is judged by so many apertures along it, each of which stands for its share of all."""
_FIRST: Final = 2.0
"""So many are flown as chosen, then straight with the least weave until the target is near: there will be another
choice. It is looked ahead by so many at least."""
_APART_M: Final = 3.0
"""Places that are farther apart than this are as bad as this."""
_BOUND_RAD_M: Final = 1.2e-3
"""Standard deviation of a direction times the extent (standard deviation) of the aperture across it."""
_BEND_M: Final = 1e-3
"""The same of 1 / range, times the square of the extent [m]."""
_THIN_M: Final = 0.0167
"""A path that is wound so thinly (standard deviation across its axis) is a line to many an estimate, and gives none:
with a third of the default weave one in four, with a half one in fifty."""
_CONFIRMED: Final = 0.6
"""Apertures with an estimate that an arrival takes to be confirmed."""
_LEAST_TOLD: Final = 0.05
_FLAT_M2: Final = 1e-6
_LEAST_M: Final = 0.3
_KEPT_S: Final = 0.1
"""By which another way must be better than the one that is flown: a choice that flutters is none."""
_OTHER_SIDE_S: Final = 0.5
"""And one to the other side: at a fence neither is good for long."""
_MARGIN_M: Final = 0.6
_CLEAR_M: Final = 0.35


@dataclass(frozen=True, slots=True)
class Way:
    """`lead_rad` beside the target, to the left where `side` is +1; `weave` is the share of the helix's radius."""

    lead_rad: float
    side: int
    weave: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Craft:
    """How the vehicle flies: one turn of a helix in `length_m`, of these radii at most across and up."""

    speed_m_s: float
    acceleration_m_s2: float
    length_m: float
    across_m: float
    up_m: float

    def forward_m_s(self, weave: _Floats) -> _Floats:
        """Along the axis of helices with these shares of the radii."""
        turning = (_WEAVE_GAIN * math.tau / self.length_m * weave) ** 2 * (self.across_m**2 + self.up_m**2) / 2
        return np.asarray(self.speed_m_s * np.sqrt(np.maximum(0.25, 1.0 - turning)))

    def told(self, weave: _Floats) -> _Floats:
        """Share of apertures that give an estimate, of the same helices."""
        thin_m2 = weave**2 * (self.across_m**2 + self.up_m**2) / 4
        return np.asarray(np.maximum(1.0 - np.exp(-thin_m2 / _THIN_M**2), _LEAST_TOLD))


def ways(side: int, weaves: Sequence[float] = _WEAVES) -> tuple[Way, ...]:
    """All there are, straight ones first, those to `side` before the others."""
    straight = [Way(0.0, side, weave) for weave in weaves]
    beside = itertools.product((side, -side), _LEADS_RAD, weaves)
    return (*straight, *(Way(lead, to, weave) for to, lead, weave in beside))


def choose(
    scatter: Scatter,
    target_m: Vector3,
    p_m: Vector3,
    near_m: float,
    *,
    craft: Craft,
    limits: GateLimits,
    others_m: Sequence[Vector3],
    before: Way,
) -> Way:
    """The way to fly from `p_m` until the belief is another one, towards the likeliest place `target_m` until `near_m`
    on the level from it and then around it, past robots at `others_m`. Of ways that are as good the one that is flown,
    `before`."""
    choices = ways(before.side, _WEAVES if craft.up_m > 0.0 else (1.0,))
    lead, side, weave = np.array([(way.lead_rad, way.side, way.weave) for way in choices]).T
    flown = _flown(lead, side, target_m, p_m, near_m=near_m, craft=craft)
    weaves = np.where(flown.is_chosen, weave[:, None], choices[0].weave)
    told = craft.told(weaves)
    first_m = np.minimum(flown.ahead_m, _FIRST * craft.length_m)
    seconds = first_m / craft.forward_m_s(weave) + (flown.ahead_m - first_m) / craft.forward_m_s(weaves[:, -1])
    seconds += _turning_s(lead * side, before, craft) + _CONFIRMED * craft.length_m / craft.speed_m_s / told[:, -1]
    apertures = told * flown.ahead_m[:, None] / craft.length_m / _LOOKS
    apart_m = _left_apart_m(scatter, flown, weaves, apertures, target_m=target_m, craft=craft)
    cost_s = seconds + apart_m / craft.speed_m_s
    cost_s += np.array([0.0 if way == before else _KEPT_S for way in choices]) + _OTHER_SIDE_S * (side != before.side)
    outside = _outside(flown.looks_m, limits, others_m)
    # Rounded, so that what is as good stays so whichever way the processor rounds.
    cost_s = np.where(outside <= outside.min(), np.round(cost_s, 3), math.inf)
    return choices[int(np.argmin(cost_s))]


class _Flown(NamedTuple):
    """Of ways (C,)."""

    looks_m: _Floats
    """(C, K, 3) where their apertures are looked at,"""
    lead_rad: _Floats
    """(C, K) flown how far beside the target,"""
    is_chosen: npt.NDArray[np.bool_]
    """(C, K) and whether as chosen, or after that."""
    ahead_m: _Floats
    """(C,) how far it is looked ahead."""


def _flown(lead: _Floats, side: _Floats, target_m: Vector3, p_m: Vector3, *, near_m: float, craft: Craft) -> _Flown:
    """A way always so far beside the target is a logarithmic spiral; then it goes straight on, and around."""
    east, north = p_m[0] - target_m[0], p_m[1] - target_m[1]
    away_m = max(math.hypot(east, north), near_m)
    cosine = np.cos(lead)
    beside_m = np.minimum((away_m - near_m) / cosine, _FIRST * craft.length_m)
    after_m = away_m - beside_m * cosine
    inwards_m = beside_m + after_m - near_m
    ahead_m = np.maximum(inwards_m, _FIRST * craft.length_m)
    gone_m = ahead_m[:, None] * (np.arange(_LOOKS) + 0.5) / _LOOKS
    led_m = np.minimum(gone_m, beside_m[:, None])
    from_m = away_m - led_m * cosine[:, None]
    range_m = np.maximum(from_m - (gone_m - led_m), near_m)
    circled_m = np.maximum(gone_m - inwards_m[:, None], 0.0)
    turned = np.tan(lead)[:, None] * np.log(away_m / from_m) + circled_m / near_m
    # Who keeps the target to the right goes around it clockwise.
    at = math.atan2(north, east) - side[:, None] * turned
    x, y = target_m[0] + range_m * np.cos(at), target_m[1] + range_m * np.sin(at)
    looks_m = np.stack([x, y, np.full(x.shape, p_m[2])], axis=2)
    beside = np.where(circled_m > 0.0, math.pi / 2, np.where(gone_m > led_m, 0.0, lead[:, None]))
    return _Flown(looks_m, beside, gone_m <= _FIRST * craft.length_m, ahead_m)


def _turning_s(lead: _Floats, before: Way, craft: Craft) -> _Floats:
    """(C,) lost by turning to signed leads (C,) from the way before."""
    turn = np.abs(lead - before.side * before.lead_rad)
    return np.asarray(craft.speed_m_s * np.sin(turn / 2) / craft.acceleration_m_s2)


def _left_apart_m(
    scatter: Scatter, flown: _Flown, weave: _Floats, apertures: _Floats, *, target_m: Vector3, craft: Craft
) -> _Floats:
    """(C,) how far two places are apart, on the average, between which `apertures` (C, K) do not tell."""
    looks_m = flown.looks_m
    places_m = scatter.p_local_enu_m
    offsets_m = places_m - looks_m[:, :, None, :]
    flat_m = np.hypot(offsets_m[..., 0], offsets_m[..., 1])
    range_m = np.hypot(flat_m, offsets_m[..., 2])
    seen_m = np.array(target_m) - looks_m
    straight = np.arctan2(seen_m[..., 1], seen_m[..., 0])[:, :, None]
    across = np.arctan2(offsets_m[..., 1], offsets_m[..., 0]) + scatter.heading_rad - straight
    across -= math.tau * np.round(across / math.tau)
    down = np.arctan2(flat_m, offsets_m[..., 2]) + scatter.elevation_rad
    precisions = _precisions(scatter.rooms, seen_m, flown.lead_rad, weave, craft=craft)
    told = np.sqrt(precisions * apertures)[..., None]
    found = np.concatenate([told[0] * across, told[1] * down, told[2] / np.maximum(range_m, _LEAST_M)], axis=1)
    alike = found.transpose(0, 2, 1) @ found  # too small for threads
    own = 0.5 * np.square(found).sum(axis=1)
    taken_for = np.exp(alike - own[:, :, None] - own[:, None, :])
    apart_m = np.minimum(np.sqrt(np.square(places_m[:, None] - places_m).sum(axis=2)), _APART_M)
    return np.asarray(((taken_for * apart_m).sum(axis=2) / taken_for.sum(axis=2)).mean(axis=1))


def _precisions(rooms: _Floats, seen_m: _Floats, lead: _Floats, weave: _Floats, *, craft: Craft) -> _Floats:
    """(3, C, K) of azimuth, polar angle [1 / rad2] and 1 / range [m2] by one aperture of a source at `seen_m`
    (C, K, 3)."""
    flat_m, range_m = np.hypot(seen_m[..., 0], seen_m[..., 1]), np.linalg.norm(seen_m, axis=2)
    along_m = craft.length_m * craft.forward_m_s(weave) / craft.speed_m_s
    level_m2 = (along_m * np.sin(lead)) ** 2 / 12 + (weave * craft.across_m) ** 2 / 2
    upright_m2 = (weave * craft.up_m) ** 2 / 2
    across_rad2, down_rad2 = (_BOUND_RAD_M**2 / np.maximum(extent_m2, _FLAT_M2) for extent_m2 in (level_m2, upright_m2))
    bend2 = CURVATURE_STD_PER_M**2 + (CURVATURE_SCALE * _BEND_M / np.maximum(level_m2 + upright_m2, _FLAT_M2)) ** 2
    afar = is_afar(range_m)
    total = np.zeros((3, *range_m.shape))
    for probability, room in zip(rooms.tolist(), REGIMES, strict=True):
        (near, far, _), (shown, hidden) = room.reported, room.unseen
        direct = probability * room.counted * (near + (far - near) * afar)
        total[0] += direct * (flat_m / range_m) ** 2 / (room.across_std_rad**2 + across_rad2)
        total[1] += direct / (room.down_std_rad**2 + down_rad2)
        total[2] += direct * room.trusted * (1.0 - shown - (hidden - shown) * afar) / bend2
    return total


def _outside(looks_m: _Floats, limits: GateLimits, others_m: Sequence[Vector3]) -> _Floats:
    """(C,) how many of the looks (C, K, 3) are where the vehicle must not be. Heights are the same on all ways."""
    middle_m = (limits.fence_min_m[2] + limits.fence_max_m[2]) / 2
    level_m = np.concatenate([looks_m[..., :2], np.full((*looks_m.shape[:2], 1), middle_m)], axis=2)
    out = ~Reach(limits, -_MARGIN_M)(level_m.reshape(-1, 3)).reshape(looks_m.shape[:2])
    for other_m in others_m:
        out |= np.linalg.norm(looks_m - np.array(other_m), axis=2) < limits.min_neighbour_m + _CLEAR_M
    return np.asarray(out.sum(axis=1))
