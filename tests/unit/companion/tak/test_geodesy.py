"""Local offsets on the ellipsoid, against the way by Earth-centred coordinates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.tak.geodesy import Place, beside

A, E2 = 6378137.0, 6.69437999014e-3


def ecef(latitude_deg: float, longitude_deg: float, hae_m: float) -> np.ndarray:
    lat, lon = math.radians(latitude_deg), math.radians(longitude_deg)
    n = A / math.sqrt(1 - E2 * math.sin(lat) ** 2)
    flat = (n + hae_m) * math.cos(lat)
    return np.array([flat * math.cos(lon), flat * math.sin(lon), (n * (1 - E2) + hae_m) * math.sin(lat)])


@pytest.mark.parametrize("latitude_deg", [-60.0, -33.0, 0.0, 47.4, 60.0])
@pytest.mark.parametrize("offset", [(30.0, -20.0, 5.0), (700.0, 700.0, 0.0)])
def test_an_offset_is_where_earth_centred_axes_put_it(latitude_deg: float, offset: tuple[float, float, float]) -> None:
    start = Place(latitude_deg, 8.5, 500.0)
    end = beside(start, offset)
    lat, lon = math.radians(latitude_deg), math.radians(8.5)
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    north = np.cross(up, east)
    assert end.hae_m is not None
    apart = ecef(end.latitude_deg, end.longitude_deg, end.hae_m) - ecef(latitude_deg, 8.5, 500.0)
    # On the ground, not on the plane that touches it; the radii are those of the ellipsoid, not of 500 m above.
    assert [apart @ east, apart @ north] == pytest.approx(offset[:2], abs=0.2)
    assert apart @ up == pytest.approx(offset[2] - (offset[0] ** 2 + offset[1] ** 2) / (2 * A), abs=0.05)


def test_across_the_date_line_and_without_a_height() -> None:
    end = beside(Place(10.0, 179.9999, None), (50.0, 0.0, 3.0))
    assert -180.0 <= end.longitude_deg < -179.99 and end.hae_m is None
