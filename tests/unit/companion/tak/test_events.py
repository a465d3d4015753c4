"""Events as the schema wants them, whatever is in them."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from companion.tak.events import DRONE, GPS, UNKNOWN_M, CotEvent, ellipse_95, sensor, xml
from companion.tak.geodesy import Place
from tests.cot import read_cot

NOW = datetime(2026, 3, 1, 12, 30, 15, 123456, UTC)
PLACE = Place(47.397742, 8.545594, 535.5)


def test_an_event_holds_what_the_schema_asks_for_and_nothing_else() -> None:
    event = CotEvent(uid="a.1", kind=DRONE, how=GPS, place=PLACE, ce_m=0.8, le_m=1.2, stale_s=10.0)
    data = xml(event, NOW)
    assert b"\n" not in data and data.startswith(b"<?xml")
    got = read_cot(data)
    assert (got.uid, got.kind, got.how) == ("a.1", "a-f-A-M-H-Q", "m-g")
    assert got.point == {"lat": 47.397742, "lon": 8.545594, "hae": 535.5, "ce": 0.8, "le": 1.2}
    assert got.stale - got.time == timedelta(seconds=10)
    assert got.time == NOW.replace(microsecond=123000)


@pytest.mark.parametrize("nothing", [None, math.inf, math.nan])
def test_what_is_not_known_is_told_as_the_schema_tells_it(nothing: float | None) -> None:
    event = CotEvent(uid="a", kind=DRONE, how=GPS, place=Place(0.0, 0.0, nothing), stale_s=1.0)
    point = read_cot(xml(event, NOW)).point
    assert (point["hae"], point["ce"], point["le"]) == (UNKNOWN_M,) * 3


def test_a_name_of_any_letters_stays_one_name() -> None:
    said = '<Rettung & "Süd">\'1'
    event = CotEvent(
        uid=said, kind=DRONE, how=GPS, place=PLACE, stale_s=1.0, details=[("contact", {"callsign": said}, said)]
    )
    got = read_cot(xml(event, NOW))
    assert got.uid == said == got.of("contact")["callsign"]


@pytest.mark.parametrize("letter", ["\x07", "\x00", "\ud800", "\uffff"])
def test_a_letter_that_xml_has_not_costs_itself_alone(letter: str) -> None:
    said = f"a{letter}b"
    details = [("contact", {"callsign": said}, ""), ("remarks", {}, f"{said}\nmore")]
    got = read_cot(xml(CotEvent(uid=said, kind=DRONE, how=GPS, place=PLACE, stale_s=1.0, details=details), NOW))
    assert (got.uid, got.of("contact")["callsign"], got.detail.findtext("remarks")) == ("a?b", "a?b", "a?b more")


def test_an_ellipse_holds_95_percent_and_points_where_the_error_is() -> None:
    rng = np.random.default_rng(1)
    along = math.radians(30.0)  # from North, clockwise
    turn = np.array([[math.sin(along), math.cos(along)], [math.cos(along), -math.sin(along)]])
    covariance = turn @ np.diag([9.0, 1.0]) @ turn.T
    ellipse = ellipse_95(covariance)
    assert ellipse.angle_deg == pytest.approx(30.0)
    points = rng.multivariate_normal((0.0, 0.0), covariance, 20_000) @ turn
    inside = (points[:, 0] / ellipse.major_m) ** 2 + (points[:, 1] / ellipse.minor_m) ** 2 <= 1
    assert inside.mean() == pytest.approx(0.95, abs=0.005)
    got = read_cot(xml(CotEvent(uid="e", kind=DRONE, how=GPS, place=PLACE, stale_s=1.0, ellipse=ellipse), NOW))
    assert got.of("ellipse") == {"major": "7.34", "minor": "2.45", "angle": "30.0"}


def test_a_wedge_is_never_wider_than_all_around() -> None:
    name, attributes, _ = sensor(-10.0, 900.0, 50.0)
    assert (name, attributes["azimuth"], attributes["fov"], attributes["range"]) == ("sensor", "350.0", "360.0", "50")
