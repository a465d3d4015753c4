"""What a person is told of a flight: only what is known, in numbers that JSON has."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, VehicleState
from companion.flight.status import status, vehicle_name
from tests.unit.companion.flight.known import NOW_NS, TARGET, Known, iteration

VEHICLE = VehicleState(
    t_mono_ns=NOW_NS, heartbeat_mono_ns=NOW_NS - NS_PER_S // 2, mode=FlightMode.OFFBOARD, armed=True, in_air=True,
    system_id=3, autopilot="px4", firmware="1.16.1", battery_remaining=0.7,
)  # fmt: skip


def told(known: Known, vehicle: VehicleState = VEHICLE) -> dict[str, Any]:
    found = status(
        course=known.course, knowledge=known.knowledge, vehicle=vehicle, control="fly", not_ready=["no poses"],
        path_m=0.4, streaming=True, overruns=2,
    )  # fmt: skip
    return json.loads(json.dumps(found, allow_nan=False))  # type: ignore[no-any-return]


def test_before_anything_was_heard_nothing_is_claimed() -> None:
    found = told(Known(), VehicleState(t_mono_ns=NOW_NS))
    assert (found["packet_age_s"], found["bearing"], found["target"], found["target_range_m"]) == (None,) * 4
    assert found["vehicle"]["heartbeat_age_s"] is None
    assert found["camera"] is None
    assert [robot["id"] for robot in found["robots"]] == [2, 3]


def test_a_bearing_is_told_in_degrees_and_without_what_is_not_observable() -> None:
    known = Known()
    known.hear(TARGET)
    known.knowledge.add_iteration(iteration())
    found = told(known)
    assert found["bearing"]["azimuth_deg"] == pytest.approx(math.degrees(0.5))
    assert found["bearing"]["azimuth_std_deg"] == pytest.approx(math.degrees(0.03))
    assert found["bearing"]["elevation_deg"] == pytest.approx(0.0)
    assert found["bearing"]["elevation_std_deg"] is None
    assert found["packet_age_s"] == 0.0
    assert found["target"]["azimuth_deg"] == pytest.approx(math.degrees(0.5), abs=10.0)
    assert found["robots"][0]["place"] == found["target"]
    assert found["robots"][1]["place"] is None


def test_what_was_given_is_told_as_it_is() -> None:
    found = told(Known())
    assert (found["control"], found["not_ready"], found["path_m"], found["streaming"], found["overruns"]) == (
        "fly", ["no poses"], 0.4, True, 2,
    )  # fmt: skip
    assert (found["vehicle"]["mode"], found["vehicle"]["battery"]) == ("offboard", 0.7)
    assert found["vehicle"]["heartbeat_age_s"] == pytest.approx(0.5)


def test_a_vehicle_is_named_by_what_it_says_it_is() -> None:
    assert vehicle_name(VEHICLE) == "system 3, px4 1.16.1"
    assert vehicle_name(replace(VEHICLE, autopilot="", firmware="")) == "system 3, unknown"
    assert vehicle_name(replace(VEHICLE, system_id=None)) == "no vehicle"
