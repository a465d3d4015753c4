"""Places near a known one on the WGS-84 ellipsoid.

By the radii of curvature at the known place: right to 0.1 m at 1 km, up to 60 degrees of latitude (what is left out is
d² tan(latitude) / 2 R).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.messages import Vector3

_A_M: Final = 6378137.0
_E2: Final = 6.69437999014e-3


@dataclass(frozen=True, slots=True)
class Place:
    """`hae_m` above the ellipsoid; None where it is not known."""

    latitude_deg: float
    longitude_deg: float
    hae_m: float | None


def beside(place: Place, offset_enu_m: Vector3) -> Place:
    """The place `offset_enu_m` (East, North, Up) from another."""
    latitude = math.radians(place.latitude_deg)
    shared = 1 - _E2 * math.sin(latitude) ** 2
    across_m = _A_M / math.sqrt(shared)
    along_m = _A_M * (1 - _E2) / shared**1.5
    east_m, north_m, up_m = offset_enu_m
    longitude_deg = place.longitude_deg + math.degrees(east_m / (across_m * math.cos(latitude)))
    return Place(
        place.latitude_deg + math.degrees(north_m / along_m),
        (longitude_deg + 180.0) % 360.0 - 180.0,
        None if place.hae_m is None else place.hae_m + up_m,
    )
