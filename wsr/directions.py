"""The grid of directions, a profile over it and a peak of it, as they are handed on.

Nothing here computes, so that who only reads results does without the compiled kernel: a service whose estimates are
made in a process of their own starts in half the time, and holds 65 MB less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROWS = 180
"""Rows of the one-degree grid."""


def grid(rows: int = ROWS) -> tuple[Array, Array]:
    """Azimuths (2 rows,) from -pi on and polar angles (rows,) half a step off the poles, both in steps of pi / rows."""
    step = np.pi / rows
    azimuth: Array = -np.pi + step * np.arange(2 * rows, dtype=np.float64)
    polar: Array = step * (np.arange(rows, dtype=np.float64) + 0.5)
    return azimuth, polar


AZIMUTH_RAD, POLAR_RAD = grid()
"""The one-degree grid: azimuth (360,) from -180 to 179 degrees, polar angle (180,) from 0.5 to 179.5."""


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """power (T, P) float32, 1 for perfect coherence; polar_rad (T,) over its rows, azimuth_rad (P,) its columns.

    `undersampled`: lobes may be narrower than the steps it was computed with, and the highest may lie between them.
    """

    power: NDArray[np.float32]
    azimuth_rad: Array
    polar_rad: Array
    undersampled: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """A direction of high power: `power` is 1 for perfect coherence, `relative_power` is 1 for the highest peak.

    `prominence` is its height over the highest saddle to a higher peak, in units of `power`; `width_rad` the diameter
    of the region around it above half of its power. Both are 0 where nobody looked: a mirror image has those of what
    it mirrors. Of paths found by subtraction see `wsr.estimators.arrivals`.
    """

    azimuth_rad: float
    polar_rad: float
    power: float
    relative_power: float
    prominence: float = 0.0
    width_rad: float = 0.0
