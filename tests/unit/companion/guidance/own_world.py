"""What the tracker takes worlds to be before it has heard anything."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def ranges_m(rng: np.random.Generator, count: int) -> Floats:
    """(count,) of targets, as the tracker takes them to be before it has heard anything."""
    low, high = 0.5, 40.0
    logarithmic = np.exp(rng.uniform(math.log(low), math.log(high), count))
    return np.asarray(np.where(rng.uniform(size=count) < 0.7, rng.uniform(low, high, count), logarithmic))
