"""What a vehicle believes of the target's place, held against the truth. The only place that knows what a belief of
the tracker looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from companion.core.messages import Vector3
from companion.guidance.tracker import Target

Array = npt.NDArray[np.float64]

PLACE_DEGREES: Final = 3
_RANGE_90: Final = 1.6448536269514722
_DIRECTION_90: Final = float(chi2.ppf(0.9, 2))


class Belief(NamedTuple):
    """Mean (3,) and covariance (3, 3) of the target's place in the vehicle's local frame."""

    mean_m: Array
    covariance_m2: Array


class BeliefCheck(NamedTuple):
    """One report against the truth: squared error normalised by the covariance, whose mean should be 3, and whether the
    90 % intervals of range and direction, seen from the vehicle, hold the truth."""

    nees: float
    range_held: bool
    direction_held: bool


def belief_of(target: Target, target_p_enu_m: Vector3) -> Belief:
    """Of the likeliest source, when the target's own poses said `target_p_enu_m`."""
    return Belief(np.array(target.place(target_p_enu_m)), np.array(target.covariance_m2))


def check(belief: Belief, truth_m: Vector3, from_m: Vector3) -> BeliefCheck:
    """`from_m` is where the vehicle is."""
    miss_m = np.array(truth_m) - belief.mean_m
    nees = float(miss_m @ np.linalg.solve(belief.covariance_m2, miss_m))
    away_m = belief.mean_m - from_m
    along = away_m / np.linalg.norm(away_m)
    range_std_m = math.sqrt(float(along @ belief.covariance_m2 @ along))
    true_range_m, range_m = math.dist(truth_m, from_m), float(np.linalg.norm(away_m))
    across = np.linalg.svd(along[None])[2][1:]
    seen_m2 = across @ belief.covariance_m2 @ across.T
    # At the range of the mean: a truth in the right direction, nearer or farther, is no miss of the direction.
    off_m = across @ (np.subtract(truth_m, from_m) * range_m / true_range_m)
    direction = float(off_m @ np.linalg.solve(seen_m2, off_m))
    in_front = float(np.dot(along, np.subtract(truth_m, from_m))) > 0
    return BeliefCheck(
        nees, abs(true_range_m - range_m) <= _RANGE_90 * range_std_m, in_front and direction <= _DIRECTION_90
    )


def share_in_band(missions: Sequence[Sequence[float]], least: int) -> float | None:
    """The share of report numbers at which the mean NEES over missions lies in its 95 % band (Bar-Shalom, Li and
    Kirubarajan, Estimation with Applications, 5.4.2); None where no report was made by `least` missions or more."""
    inside = []
    for number in range(max((len(mission) for mission in missions), default=0)):
        values = [mission[number] for mission in missions if len(mission) > number]
        if len(values) >= least:
            low, high = chi2.ppf([0.025, 0.975], PLACE_DEGREES * len(values)) / len(values)
            inside.append(low <= float(np.mean(values)) <= high)
    return float(np.mean(inside)) if inside else None
