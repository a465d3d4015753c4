"""What the pictures get: degrees, elevations above the horizon, ellipses, and None for what is not known."""

from __future__ import annotations

import math

import pytest

from companion.page.parts import bearing_part, compass_deg, elevation_deg, target_part, vehicle_part
from tests.page_messages import S, iteration, target, vehicle


def test_a_bearing_is_rounded_and_looks_above_the_horizon() -> None:
    part = bearing_part(iteration(), 5.0)
    assert part is not None
    assert part["azimuth_deg"] == -60.0 and part["azimuth_std_deg"] == 2.0
    assert part["elevation_deg"] == -5.0  # 95 degrees from the zenith are 5 below the horizon
    assert part["others"] == [{"azimuth_deg": 57.3, "share": 0.4}]


def test_what_an_aperture_does_not_tell_is_none() -> None:
    seen = iteration()
    seen["estimate"] |= {"polar_observable": False, "azimuth_std_rad": None}
    part = bearing_part(seen, 5.0)
    assert part is not None
    assert part["elevation_deg"] is None and part["azimuth_std_deg"] is None
    assert bearing_part(iteration(estimate=None, refusal="too few"), 5.0) is None


def test_a_targets_ellipse_lies_along_its_doubt() -> None:
    turned = math.radians(30.0)
    c, s = math.cos(turned), math.sin(turned)
    covariance = [[4 * c * c + s * s, 3 * c * s, 0.0], [3 * c * s, 4 * s * s + c * c, 0.0], [0.0, 0.0, 1.0]]
    part = target_part(target(covariance_m2=covariance), 5.0)
    assert part["ellipse"] == {"major_m": 2.0, "minor_m": 1.0, "turn_deg": pytest.approx(30.0)}
    assert part["rivals"] == [{"p_m": [1.0, 9.0, 0.3], "probability": 0.1}]  # moved along with the target


def test_a_target_of_an_older_log_has_no_ellipse() -> None:
    old = target()
    for key in ("covariance_m2", "rivals", "probability"):
        del old["target"][key]
    part = target_part(old, 5.0)
    assert part["ellipse"] is None and part["rivals"] == [] and part["probability"] is None
    assert target_part(target() | {"p_local_enu_m": None}, 5.0)["p_m"] is None


def test_a_vehicle_is_named_and_its_link_aged() -> None:
    part = vehicle_part(vehicle(), 102 * S)
    assert part["name"] == "system 1, px4 1.16.1" and part["heartbeat_age_s"] == 2.0


def test_a_vehicle_that_does_not_tell_whether_it_flies_is_not_said_to_stand() -> None:
    assert vehicle_part(vehicle() | {"in_air": False}, S)["in_air"] is False
    assert vehicle_part(vehicle() | {"in_air": False, "landed_unknown": True}, S)["in_air"] is None


@pytest.mark.parametrize(("azimuth", "compass"), [(0.0, 90.0), (90.0, 0.0), (180.0, 270.0), (-90.0, 180.0)])
def test_compass_bearings_count_from_north_clockwise(azimuth: float, compass: float) -> None:
    assert compass_deg(azimuth) == compass


def test_elevation_is_zero_at_the_horizon() -> None:
    assert elevation_deg(math.pi / 2) == 0.0 and elevation_deg(0.0) == 90.0
