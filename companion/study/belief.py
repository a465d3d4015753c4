"""What a vehicle believes of the target's place, held against the truth. The only place that knows what a belief of
the tracker looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from companion.core.messages import Vector3
from companion.guidance.target import Target
from companion.study.chi_square import middle_95

PLACE_DEGREES: Final = 3


class BeliefCheck(NamedTuple):
    """One report against the truth: squared error normalised by the covariance, whose mean should be 3, and whether the
    90 % intervals of range and direction, seen from the vehicle, hold the truth."""

    nees: float
    range_held: bool
    direction_held: bool


def check(target: Target, target_p_enu_m: Vector3, truth_m: Vector3, from_m: Vector3) -> BeliefCheck:
    """The whole belief, all sources counted, when the target's own poses said `target_p_enu_m`; `from_m` is where the
    vehicle is. A belief of several sources has no normal density, but whatever its shape, a truth drawn from it has a
    mean NEES of 3."""
    whole = target.whole
    miss_m = np.subtract(truth_m, np.add(whole.origin_local_enu_m, target_p_enu_m))
    nees = float(miss_m @ np.linalg.solve(np.array(whole.covariance_m2), miss_m))
    likeliest_m = np.subtract(target.place(target_p_enu_m), from_m)
    offset_m = np.subtract(truth_m, from_m)
    range_m = float(np.linalg.norm(offset_m))
    cosine = float(offset_m @ likeliest_m) / max(range_m * float(np.linalg.norm(likeliest_m)), 1e-9)
    nearest_m, farthest_m = whole.range_90_m
    return BeliefCheck(
        nees, nearest_m <= range_m <= farthest_m, math.acos(max(-1.0, min(1.0, cosine))) <= whole.direction_90_rad
    )


def share_in_band(missions: Sequence[Sequence[float]], least: int) -> float | None:
    """The share of report numbers at which the mean NEES over missions lies in its 95 % band (Bar-Shalom, Li and
    Kirubarajan, Estimation with Applications, 5.4.2); None where no report was made by `least` missions or more."""
    inside = []
    for number in range(max((len(mission) for mission in missions), default=0)):
        values = [mission[number] for mission in missions if len(mission) > number]
        if len(values) >= least:
            low, high = middle_95(PLACE_DEGREES * len(values)) / len(values)
            inside.append(low <= float(np.mean(values)) <= high)
    return float(np.mean(inside)) if inside else None
