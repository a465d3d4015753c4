"""An estimate by hand."""

from __future__ import annotations

import math
from typing import Any

from wsr.aoa import AoaEstimate


def estimate(**changes: Any) -> AoaEstimate:
    """Of 100 packets, in both angles observable."""
    values: dict[str, Any] = {
        "azimuth_rad": 0.0, "polar_rad": 1.5, "azimuth_std_rad": 0.02, "polar_std_rad": 0.03,
        "covariance": ((4e-4, 0.0, 0.0), (0.0, 9e-4, 0.0), (0.0, 0.0, math.inf)), "crb_rad": 0.01, "coherence": 0.9,
        "reliability": 0.8, "azimuth_observable": True, "polar_observable": True, "alternatives": (), "packets": 100,
        "length_m": 1.2, "extents_m": (0.5, 0.4, 0.3), "reference_p_m": (1.0, 2.0, 3.0), "reference_t_s": 4.0,
    }  # fmt: skip
    return AoaEstimate(**values | changes)
