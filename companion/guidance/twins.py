"""Places that a drawing has made several of the same, parted again."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

_Floats = npt.NDArray[np.float64]

ACROSS: Final = 0.005
"""They part by so much of the range across the line of sight,"""
SHARE: Final = 0.2
ALONG: Final = (0.01, 0.08)
"""and along it by such a share of how far the ranges of all are apart, from and to so much of the range: while they are
vague, few would else be left."""


def parted(offsets_m: _Floats, rng: np.random.Generator) -> _Floats:
    """Of places at `offsets_m` (N, 3) from where they are seen."""
    range_m = np.sqrt(np.einsum("nx,nx->n", offsets_m, offsets_m))
    least, most = ALONG
    along = min(most, max(least, SHARE * float(np.log(np.maximum(range_m, 1e-3)).std())))
    ratio = np.exp(rng.normal(0.0, along, len(range_m)))
    across_m = rng.normal(0.0, ACROSS, offsets_m.shape) * (ratio * range_m)[:, None]
    return np.asarray(ratio[:, None] * offsets_m + across_m)
