"""The health list: worst first, each with what to do, and no alarm for what is normal."""

from __future__ import annotations

from typing import Any

import pytest

from companion.page.health import BAD, OK, WARNING, HealthLook, health_list
from tests.page_messages import S, health, known, vehicle


def look(**values: Any) -> HealthLook:
    told: dict[str, Any] = {"health": health(), "vehicle": vehicle(), "packets_hz": 140.0, "free_mib": 5000.0}
    return HealthLook(known=known(), t_ns=100 * S, **{"worker_ready": True} | told | values)


def test_a_normal_flight_alarms_nobody() -> None:
    assert {item.level for item in health_list(look())} == {OK}


@pytest.mark.parametrize(
    ("values", "level", "name"),
    [
        ({"vehicle": None}, BAD, "autopilot"),
        ({"vehicle": vehicle(heartbeat_mono_ns=97 * S)}, BAD, "autopilot"),
        ({"vehicle": vehicle(failsafe=True)}, BAD, "autopilot"),
        ({"vehicle": vehicle(estimator_healthy=False)}, BAD, "autopilot"),
        ({"vehicle": vehicle(battery_remaining=0.1)}, BAD, "battery"),
        ({"vehicle": vehicle(battery_remaining=0.25)}, WARNING, "battery"),
        ({"vehicle": vehicle(battery_remaining=None)}, WARNING, "battery"),
        ({"health": health(pose_age_s=None)}, BAD, "poses"),
        ({"health": health(pose_age_s=1.0)}, BAD, "poses"),
        ({"health": health(poses={"lost": True})}, BAD, "poses"),
        ({"health": health(poses={"problem": "low rate"})}, WARNING, "poses"),
        ({"packets_hz": 0.0}, BAD, "card"),
        ({"packets_hz": 10.0}, WARNING, "card"),
        ({"health": health(lookalikes=[["a", "b"]])}, WARNING, "card"),
        ({"health": health(network_problem="interface robots is down")}, BAD, "network"),
        ({"worker_ready": False}, BAD, "AOA worker"),
        ({"gate": ["fence"]}, WARNING, "gate"),
        ({"health": health(recorder={"dropped": 5})}, WARNING, "log"),
        ({"health": health(recorder={"failures": 1})}, WARNING, "log"),
        ({"free_mib": 100.0}, BAD, "disk"),
        ({"camera": {"leads": "radio", "frame_age_s": None}}, WARNING, "tag camera"),
        ({"camera": {"leads": "radio", "frame_age_s": 3.0}}, WARNING, "tag camera"),
        ({"silent_s": 4.0}, BAD, "service"),
        ({"health": None}, WARNING, "service"),
    ],
)
def test_each_trouble_stands_first_with_what_to_do(values: dict[str, Any], level: str, name: str) -> None:
    worst = health_list(look(**values))[0]
    assert (worst.level, worst.name) == (level, name)
    assert worst.todo


def test_who_leads_is_said_where_a_tag_camera_is_configured() -> None:
    items = health_list(look(camera={"leads": "camera", "frame_age_s": 0.1}))
    assert [item.text for item in items if item.name == "tag camera"] == ["the camera leads"]
    assert "tag camera" not in {item.name for item in health_list(look())}


@pytest.mark.parametrize(
    ("state", "level"),
    [("unheard", BAD), ("lost", BAD), ("stale", BAD), ("refused", BAD), ("discovered", WARNING), ("tracked", OK)],
)
def test_neighbours_are_judged_by_their_standing(state: str, level: str) -> None:
    told = health()
    told["neighbours"]["beacon"] |= {"state": state, "refusal": "bad key"}
    assert {item.level for item in health_list(look(health=told)) if item.name == "beacon"} == {level}


def test_a_beacon_has_no_vehicle_to_miss() -> None:
    heard = health()
    heard["neighbours"]["beacon"] |= {"state": "discovered", "pairing_rate": 0.0}
    told = HealthLook(known=known(role="beacon"), t_ns=S, health=heard, packets_hz=140.0)
    assert {item.level for item in health_list(told)} == {OK}
