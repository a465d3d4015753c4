"""How far an estimate is off: the paper's measure, and the angle between two directions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wsr.geometry import direction, great_circle


@dataclass(frozen=True, slots=True)
class AoaError:
    """In degrees: |azimuth| wrapped to 0..180, |polar angle|, the root of the sum of their squares (the paper's
    AOA_Error, eqn:AOA_euclidean_error, with the azimuth wrapped), and the great circle."""

    azimuth_deg: float
    polar_deg: float
    paper_deg: float
    great_circle_deg: float


def aoa_error(azimuth_rad: float, polar_rad: float, true_azimuth_rad: float, true_polar_rad: float) -> AoaError:
    """Of an estimate (azimuth, polar angle) against the truth."""
    azimuth = abs(math.degrees(math.remainder(azimuth_rad - true_azimuth_rad, math.tau)))
    polar = abs(math.degrees(polar_rad - true_polar_rad))
    apart = great_circle(direction(azimuth_rad, polar_rad), direction(true_azimuth_rad, true_polar_rad))
    return AoaError(azimuth, polar, math.hypot(azimuth, polar), math.degrees(float(apart)))


def share_below(values: Sequence[float], limit: float) -> float:
    """In percent."""
    return 100.0 * float(np.mean(np.asarray(values) < limit))
