"""The chi-square distribution, without `scipy.stats`, whose import takes a second of processor on a small machine."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincinv

_MIDDLE_95: Final = np.array([0.025, 0.975])


def middle_95(degrees: float) -> npt.NDArray[np.float64]:
    """Between which two values (2,) a sum of `degrees` squared standard normals lies nineteen times of twenty."""
    return np.asarray(2.0 * gammaincinv(degrees / 2.0, _MIDDLE_95))
