"""What TAK is told of a flight: ourselves with a fix, the target where it is known, else a wedge."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Any

import pytest

from companion.tak.events import xml
from companion.tak.picture import Picture, Telling
from tests.cot import Cot, read_cot
from tests.page_messages import S, iteration, known, vehicle

TELLING = Telling(uid="wsr-companion.1.uav", callsign="Rescue 7", wedge_m=50.0, stale_s=10.0)
NOW = datetime(2026, 3, 1, tzinfo=UTC)
GPS = {
    "t_mono_ns": 100 * S, "latitude_deg": 47.4, "longitude_deg": 8.5, "hae_m": 540.0, "horizontal_m": 0.8,
    "vertical_m": 1.2,
}  # fmt: skip
PEER = int(known()["target"])


def target(std_m: float = 1.0, **values: Any) -> dict[str, Any]:
    """10 m East and 20 m North of the vehicle."""
    inner = {
        "range_m": 22.4, "range_std_m": std_m, "probability": 0.9,
        "covariance_m2": [[4.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.25]],
    }  # fmt: skip
    return {"peer": PEER, "target": inner, "p_local_enu_m": [11.0, 22.0, 1.0]} | values


def told(*messages: tuple[str, int, dict[str, Any]], gps: dict[str, Any] | None = GPS) -> list[Cot]:
    picture = Picture(TELLING)
    picture.take("introduction", 0, known())
    picture.take("/vehicle", 100 * S, vehicle(gps=gps))
    for message in messages:
        picture.take(*message)
    return [read_cot(xml(event, NOW)) for event in picture.events()]


def test_without_a_fix_nothing_is_told() -> None:
    seen = ("/bearing", 99 * S, iteration(peer=PEER))
    assert told(seen, gps=None) == []
    assert told(("counts", 104 * S, {}), gps=GPS) == [], "an old fix is none"


def test_our_own_place_comes_with_its_errors() -> None:
    (own,) = told(("/mission", 99 * S, {"state": "approaching"}))
    assert (own.uid, own.kind, own.how) == ("wsr-companion.1.uav", "a-f-A-M-H-Q", "m-g")
    assert own.point == {"lat": 47.4, "lon": 8.5, "hae": 540.0, "ce": 0.8, "le": 1.2}
    assert own.of("contact") == {"callsign": "Rescue 7"}
    assert own.of("track") == {"course": "26.6", "speed": "0.22"}
    assert own.detail.findtext("remarks") == "in the air, approaching"


def test_a_vehicle_that_does_not_say_whether_it_flies_is_not_said_to_stand() -> None:
    picture = Picture(TELLING)
    picture.take("introduction", 0, known())
    picture.take("/vehicle", 100 * S, vehicle(gps=GPS, in_air=False, landed_unknown=True))
    (own,) = (read_cot(xml(event, NOW)) for event in picture.events())
    assert own.detail.findtext("remarks") == "not known whether in the air"


def test_a_direction_is_a_wedge_from_where_it_was_taken() -> None:
    seen = iteration(azimuth_rad=math.radians(-60.0), peer=PEER, p_local_enu_m=[1.0, -8.0, 1.5])
    _, wedge = told(("/bearing", 95 * S, seen))
    assert wedge.kind == "b-m-p-s-p-loc"
    assert wedge.of("sensor")["azimuth"] == "150.0"
    assert float(wedge.of("sensor")["fov"]) == pytest.approx(2 * 1.96 * 2.0, abs=0.05)
    assert wedge.point["lat"] == pytest.approx(47.4 - 10.0 / 111_180, abs=1e-6)
    assert wedge.of("link")["uid"] == TELLING.uid


def test_a_target_that_is_known_takes_the_wedges_place() -> None:
    seen = ("/bearing", 95 * S, iteration(peer=PEER))
    own, marker, ellipse = told(seen, ("/target", 95 * S, target()))
    assert (own.kind, marker.kind, ellipse.kind) == ("a-f-A-M-H-Q", "a-u-G", "u-d-c-e")
    east_m = (marker.point["lon"] - 8.5) * 111_320 * math.cos(math.radians(47.4))
    assert (east_m, (marker.point["lat"] - 47.4) * 111_180) == pytest.approx((10.0, 20.0), abs=0.1)
    assert marker.point["ce"] == pytest.approx(math.sqrt(2.5), abs=0.01) and marker.point["le"] == 1.5
    assert ellipse.of("ellipse") == {"major": "4.90", "minor": "2.45", "angle": "90.0"}
    assert marker.point == ellipse.point and ellipse.uid == f"{marker.uid}.ellipse"


def test_a_height_that_is_not_known_leaves_the_place_on_the_map() -> None:
    flat = target()["target"] | {"covariance_m2": [[4.0, 0.0, None], [0.0, 1.0, None], [None, None, None]]}
    _, marker, _ = told(("/target", 95 * S, target(target=flat)))
    assert marker.point["le"] == 9999999 and marker.point["ce"] == pytest.approx(math.sqrt(2.5), abs=0.01)


@pytest.mark.parametrize(
    "vague",
    [
        target(std_m=10.0),
        target(peer=PEER + 1),
        target(target={**target()["target"], "probability": 0.3}),
        target(target={**target()["target"], "range_std_m": None}),
        target(target={**target()["target"], "covariance_m2": [[None] * 3] * 3}),
    ],
)
def test_a_target_that_is_hardly_known_stays_a_direction(vague: dict[str, Any]) -> None:
    seen = ("/bearing", 95 * S, iteration(peer=PEER))
    assert [event.kind for event in told(seen, ("/target", 95 * S, vague))] == ["a-f-A-M-H-Q", "b-m-p-s-p-loc"]


def test_what_is_old_or_another_robots_is_not_told() -> None:
    assert len(told(("/bearing", 80 * S, iteration(peer=PEER)))) == 1
    assert len(told(("/bearing", 95 * S, iteration(peer=PEER + 1)))) == 1
    assert len(told(("/bearing", 95 * S, iteration(peer=PEER) | {"estimate": None}))) == 1
    assert len(told(("/target", 80 * S, target()))) == 1


def test_another_robot_that_is_flown_to_is_told_and_the_one_before_no_more() -> None:
    here = known(peers={str(PEER): "alpha", "7": "beta"})
    picture = Picture(TELLING)
    picture.take("introduction", 0, here)
    picture.take("/vehicle", 100 * S, vehicle(gps=GPS))
    picture.take("/target", 99 * S, target())
    picture.take("/target", 99 * S, target(peer=7))
    assert "alpha" in {read_cot(xml(event, NOW)).of("contact")["callsign"] for event in picture.events()}
    picture.take("status", 100 * S, {"target_id": PEER})
    assert len(picture.events()) == 3
    picture.take("status", 100 * S, {"target_id": 7})
    assert len(picture.events()) == 1
    picture.take("/target", 100 * S, target(peer=7))
    assert "beta" in {read_cot(xml(event, NOW)).of("contact")["callsign"] for event in picture.events()}
