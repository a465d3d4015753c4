"""What a page knows of a flight, message after message."""

from __future__ import annotations

from typing import Any

from companion.flight.records import SERVICE_ENDS
from companion.page.model import Model
from tests.page_messages import S, counts, health, iteration, known, target, vehicle


def flown() -> Model:
    model = Model()
    model.take("introduction", 0, known())
    model.take("counts", 100 * S, counts(0))
    model.take("/mission", 100 * S, step("acquiring", "approaching"))
    for k in range(1, 6):
        model.take("/vehicle", (100 + k) * S, vehicle(p_local_enu_m=[k, 0.0, 1.5], heartbeat_mono_ns=(100 + k) * S))
        model.take("counts", (100 + k) * S, counts(140 * k))
    model.take("/health", 105 * S, health())
    model.take("/bearing", 105 * S, iteration())
    model.take("/target", 105 * S, target())
    return model


def step(state: str, then: str, reason: str = "bearing") -> dict[str, Any]:
    return {"state": state, "next_state": then, "event": "bearing", "reason": reason}


def test_a_flight_is_all_there() -> None:
    view, path = flown().view(), flown().path()
    assert view["mission"]["state"] == "approaching" and view["mission"]["since_s"] == 5.0
    assert view["t_s"] == 5.0
    assert view["rates"]["packets_hz"] == 140.0 and view["rates"]["paired_percent"] == 95
    assert view["bearing"]["azimuth_deg"] == -60.0 and view["target"]["range_m"] == 8.0
    assert len(path["trail"]) == 5 and path["bearings"] == [[1.0, 2.0, -60.0, 0.81]]
    assert {item["level"] for item in view["health"]} == {"ok"}


def test_a_message_told_twice_counts_once() -> None:
    model = flown()
    model.take("/bearing", 105 * S, iteration())
    model.take("/mission", 100 * S, step("acquiring", "approaching"))
    assert len(model.path()["bearings"]) == 1
    assert len(model.view()["events"]) == 1


def test_a_refused_iteration_keeps_the_bearing_and_says_why() -> None:
    model = flown()
    model.take("/bearing", 106 * S, iteration(4, estimate=None, refusal="too few packets"))
    view = model.view()
    assert view["bearing"]["number"] == 3 and view["refusal"]["why"] == "too few packets"


def test_another_robots_bearing_is_not_the_targets() -> None:
    model = flown()
    model.take("/bearing", 106 * S, iteration(9, peer=7))
    model.take("/target", 106 * S, target() | {"peer": 7, "p_local_enu_m": [0.0, 0.0, 0.0]})
    assert model.view()["bearing"]["number"] == 3 and model.view()["target"]["p_m"] == [6.0, -5.0, 0.3]


def test_what_stands_against_engaging_is_said_at_rest_only() -> None:
    model = flown()
    model.take("status", 106 * S, {"state": "approaching", "not_ready": ["armed already"], "reason": ""})
    assert model.view()["mission"]["not_ready"] == []
    model.take("status", 107 * S, {"state": "idle", "not_ready": ["no packets"], "reason": ""})
    assert model.view()["mission"]["not_ready"] == ["no packets"]
    assert "1 thing stands" in model.view()["mission"]["next"]


def test_a_clock_that_begins_anew_is_another_flight() -> None:
    model = flown()
    model.take("counts", 10 * S, counts(0))
    assert model.path() == {"trail": [], "bearings": []}
    assert model.view()["bearing"] is None and model.view()["introduced"] and model.profile is None


def test_before_anything_was_told_there_is_a_view_too() -> None:
    view = Model().view(9.0)
    assert not view["introduced"] and view["mission"] is None and view["health"] == []


def test_topics_that_are_not_shown_are_passed_over() -> None:
    model = flown()
    before = model.version
    model.take("/tf", 106 * S, {})
    assert model.version == before


def test_another_target_is_shown_by_what_is_known_of_it() -> None:
    """Every robot's place is kept; bearings of the one before are none of this one."""
    model = flown()
    model.take("introduction", 0, known(peers={"2": "alpha", "7": "beta"}, target=2))
    model.take("/target", 106 * S, target() | {"peer": 7, "p_local_enu_m": [0.0, 9.0, 0.0]})
    assert model.view()["target_name"] == "alpha"
    assert [(one["name"], one["place"] and one["place"]["p_m"]) for one in model.view()["robots"]] == [
        ("alpha", [6.0, -5.0, 0.3]), ("beta", [0.0, 9.0, 0.0]),
    ]  # fmt: skip
    wish = {"wish": "retarget", "refusal": "", "by_switch": False, "vehicle": "", "target": 7}
    model.take("/wish", 106 * S, wish | {"refusal": "beta: no packets of the target"})
    assert model.view()["target_name"] == "alpha"
    model.take("/wish", 107 * S, wish)
    view = model.view()
    assert view["target_name"] == "beta" and view["target"]["p_m"] == [0.0, 9.0, 0.0]
    assert view["bearing"] is None and model.path()["bearings"] == []
    assert view["events"][-1]["text"] == "retarget to beta"
    model.take("/bearing", 108 * S, iteration(11, peer=7))
    assert model.view()["bearing"]["number"] == 11
    model.take("status", 109 * S, {"state": "acquiring", "reason": "retarget", "target_id": 2})
    assert model.view()["target_name"] == "alpha" and model.view()["bearing"] is None


def test_a_service_that_was_stopped_is_no_fault() -> None:
    model = flown()
    model.take("/mission", 106 * S, step("approaching", "fault", SERVICE_ENDS))
    shown = model.view()["mission"]
    assert shown["state"] == "ended" and "left the vehicle to its autopilot" in shown["next"]
    assert model.view()["events"][-1]["text"] == "approaching to ended: the service ends"
