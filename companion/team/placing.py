"""Which robots are placed, and where else one that is not may be: a bearing tells no range, and may be that of a
reflection."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.team.factors import Sightings, look, trusted

Array = npt.NDArray[np.float64]

_SHARE: Final = 0.3
_LEAST_M: Final = 0.5
"""Placed is whose deviation in any direction is no larger share of its range, or no larger than this,"""
_EVIDENCE: Final = 3.0
"""by so many apertures' worth of bearings that agree, of each pair in each direction that sees it,"""
_SUPPORT: Final = 0.6
"""which are so large a share of those that were to be expected."""
_RANGES_M: Final = (3.0, 8.0, 20.0)
_NEWEST: Final = 40
_DIRECTIONS: Final = 3
_APART: Final = math.cos(math.radians(30.0))


def supported(states: Array, sightings: Sightings) -> list[bool]:
    """Whether enough of what was seen of each robot, or by it, agrees with where all are."""
    direct = look(states, sightings).direct if len(sightings) else np.zeros(0)
    found = []
    for i in range(states.shape[1]):
        of_it = (sightings.target == i) | (sightings.observer == i)
        agreeing = float(sightings.fresh[of_it] @ direct[of_it])
        expected = float(sightings.fresh[of_it] @ trusted(sightings.reliability[of_it]))
        pairs = len(set(zip(sightings.observer[of_it].tolist(), sightings.target[of_it].tolist(), strict=True)))
        found.append(agreeing >= _EVIDENCE * max(1, pairs) and agreeing >= _SUPPORT * expected)
    return found


def is_sure(offset_m: Array, covariance_m2: Array) -> bool:
    """Whether a place relative to us (3,) is known in every direction."""
    return largest_std_m(covariance_m2) <= max(_LEAST_M, _SHARE * float(np.linalg.norm(offset_m)))


def largest_std_m(covariance_m2: Array) -> float:
    """In the direction in which a place is known worst."""
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance_m2)[-1])))


def other_guesses(i: int, states: Array, sightings: Sightings) -> Iterator[Array]:
    """The same with robot i elsewhere: where bearings that tie it to another robot point, at several ranges. With this
    robot (0), whose place is the origin, all others are elsewhere instead."""
    tried: list[Array] = []
    mine = np.flatnonzero((sightings.target == i) | (sightings.observer == i))[-_NEWEST:]
    for at in mine[np.argsort(-sightings.reliability[mine], kind="stable")]:
        k, observer, target = (int(v[at]) for v in (sightings.keyframe, sightings.observer, sightings.target))
        azimuth = sightings.measured[at, 0] + states[k, observer, 3]
        sign, base = (1.0, observer) if observer != i else (-1.0, target)
        unit = sign * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        if any(float(unit @ other) > _APART for other in tried):
            continue
        tried.append(unit)
        for range_m in _RANGES_M:
            guess = states.copy()
            shift_m = states[k, base, :3] + range_m * unit - states[k, i, :3]
            if i == 0:
                guess[:, 1:, :3] -= shift_m
            else:
                guess[:, i, :3] += shift_m
            yield guess
        if len(tried) == _DIRECTIONS:
            return
