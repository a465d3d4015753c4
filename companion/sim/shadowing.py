"""What stands in the way and how antennas are turned, as one slowly varying loss: log-normal shadowing.

Indoors its deviation is 3 to 5 dB where the direct path is seen, and it is another one after some 3 m (Gudmundson,
Correlation model for shadow fading, 1991; ITU-R P.1238). It is the same in both directions.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_STREAM: Final = 7
_WAVES: Final = 24
_LENGTHS_M: Final = (5.0, 15.0)
"""Of the waves that add up to it: after a third of one it is another."""


class Shadowing:
    """A smooth random field over the places of both ends; the same seed gives the same field."""

    def __init__(self, seed: int, std_db: float) -> None:
        rng = np.random.default_rng([seed, _STREAM])
        direction = rng.normal(size=(_WAVES, 3))
        per_m = math.tau / rng.uniform(*_LENGTHS_M, _WAVES)
        self._per_m = per_m[:, None] * direction / np.linalg.norm(direction, axis=1)[:, None]
        self._phase = rng.uniform(-math.pi, math.pi, _WAVES)
        self._amplitude_db = std_db * math.sqrt(2.0 / _WAVES)

    def gain(self, a_enu_m: Array, b_enu_m: Array) -> Array:
        """Amplitude (N,) of the link between places (N, 3) and (N, 3)."""
        level = np.cos((a_enu_m - b_enu_m) @ self._per_m.T + self._phase).sum(axis=1)
        return np.asarray(10 ** (self._amplitude_db * level / 20))
