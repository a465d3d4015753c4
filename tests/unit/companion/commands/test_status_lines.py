"""`companion status` for a person: every estimate with its deviation, and no alarm for what is normal in flight."""

from __future__ import annotations

from typing import Any

from companion.commands.status_lines import health_items, person_lines, target_words
from tests.page_messages import health, known

VEHICLE: dict[str, Any] = {
    "system_id": 1, "autopilot": "px4", "firmware": "1.16.1", "mode": "offboard", "armed": True, "in_air": True,
    "battery": 0.82, "p_local_enu_m": (5.55, -8.63, 1.5), "yaw_enu_rad": 0.0, "heartbeat_age_s": 0.2,
    "failsafe": False, "estimator_healthy": True,
}  # fmt: skip
BEARING: dict[str, Any] = {
    "azimuth_deg": -58.3, "azimuth_std_deg": 1.14, "elevation_deg": -11.2, "elevation_std_deg": 1.2,
    "reliability": 0.93, "iteration": 9, "reference_ns": 1,
}  # fmt: skip
TARGET: dict[str, Any] = {
    "range_m": 17.3, "range_std_m": 11.9, "range_90_m": [4.0, 33.8], "azimuth_deg": -60.0, "probability": 0.9,
    "rivals": 1,
}  # fmt: skip


def status(**values: Any) -> dict[str, Any]:
    return {
        "ok": True, "about": known(), "state": "approaching", "reason": "bearing", "not_ready": ["armed already"],
        "packet_age_s": 0.01, "bearing": BEARING, "bearing_stale": False, "target": TARGET, "vehicle": VEHICLE,
        "health": health(), "target_id": 2, "target_name": "beacon",
        "robots": [{"id": 2, "name": "beacon", "place": TARGET}, {"id": 3, "name": "other", "place": None}],
    } | values  # fmt: skip


def test_a_flight_in_a_persons_words() -> None:
    lines = dict(person_lines(status()))
    assert lines["state"] == "uav: approaching"
    assert lines["vehicle"] == "system 1, px4 1.16.1: offboard, armed, in the air"
    assert lines["position"] == "East 5.5, North -8.6, Up 1.5 m, heading 90°"
    assert lines["battery"] == "82 %"
    assert lines["bearing"] == (
        "compass 148° ± 1.1° (-58.3° from East), elevation -11.2° ± 1.2°, reliability 0.93, iteration 9"
    )
    assert lines["target"] == (
        "beacon: 17.3 m ± 11.9 m away, its range hardly known (4 to 34 m with 90 %); "
        "90 % sure of this place, 1 other place possible"
    )
    assert lines["other robot"] == "other (3): nothing known yet"
    assert "missing" not in lines  # what stands against engaging is no news in flight
    assert {item.level for item in health_items(status(), 5000.0)} == {"ok"}


def test_a_vehicle_that_does_not_tell_where_it_is_stands_nowhere() -> None:
    lines = dict(person_lines(status(vehicle=VEHICLE | {"in_air": False, "landed_unknown": True})))
    assert lines["vehicle"] == "system 1, px4 1.16.1: offboard, armed, not known whether in the air"


TEAM: dict[str, Any] = {
    "age_s": 0.4, "own_axes_deg": 1.5, "own_axes_std_deg": 2.1, "dropped": 0, "restarts": 0,
    "robots": {
        "two": {"placed": True, "p_own_m": (3.14, -2.0, -0.04), "std_m": 0.6, "axes_deg": 3.2, "axes_std_deg": 1.1,
                "sightings": 40},
        "three": {"placed": False, "p_own_m": (9.0, 10.0, 0.0), "std_m": 12.0, "axes_deg": 0.0, "axes_std_deg": 9.9,
                  "sightings": 4},
        "four": {"placed": False, "p_own_m": (0.0, 0.0, 0.0), "std_m": 20.0, "axes_deg": 0.0, "axes_std_deg": 9.9,
                 "sightings": 0},
    },
}  # fmt: skip


def test_the_team_has_a_line_for_each_robot() -> None:
    lines = list(person_lines(status(team=TEAM)))
    at = lines.index(("team", "two: East 3.1, North -2.0, Up 0.0 m from here, ± 0.6 m; its axes +3.2° ± 1.1° to ours"))
    assert lines[at + 1 : at + 4] == [
        ("", "three: not placed yet, about compass 42°"),
        ("", "four: no bearing of it or by it"),
        ("own axes", "+1.5° ± 2.1° by all robots' North"),
    ]


def test_a_team_that_is_off_is_not_spoken_of_and_one_that_is_silent_is() -> None:
    assert "team" not in dict(person_lines(status(team=None)))
    assert dict(person_lines(status(team=TEAM | {"robots": {}})))["team"] == "nothing new of it"
    beacon = status(state="beacon", team=TEAM | {"robots": {}, "age_s": None})
    assert dict(person_lines(beacon))["team"] == "nothing known yet"


def test_who_leads_is_said_where_a_tag_camera_is_configured() -> None:
    assert "leads" not in dict(person_lines(status()))
    camera: dict[str, object] = {"leads": "radio", "frame_age_s": None}
    assert dict(person_lines(status(camera=camera)))["leads"] == "the radio; no image of the tag camera yet"
    camera = {"leads": "camera", "frame_age_s": 0.06, "frames": 120, "believed": 40}
    told = "the camera; 40 sightings of its tag believed in 120 images, the newest 0.1 s ago"
    assert dict(person_lines(status(camera=camera)))["leads"] == told
    items = [(one.name, one.text) for one in health_items(status(camera=camera), 5000.0)]
    assert ("tag camera", "the camera leads") in items


def test_at_rest_what_is_missing_is_listed() -> None:
    lines = list(person_lines(status(state="idle", not_ready=["no packets", "no poses"])))
    assert ("missing", "no packets") in lines and ("", "no poses") in lines
    assert "2 things stand" in dict(lines)["next"]


def test_what_was_never_there_is_said_in_words() -> None:
    nobody = dict.fromkeys(VEHICLE)
    told = status(bearing=None, target=None, vehicle=nobody, packet_age_s=None, state="idle")
    lines = dict(person_lines(told))
    assert (lines["vehicle"], lines["bearing"], lines["target"]) == (
        "none heard",
        "none yet",
        "beacon: nothing known yet",
    )
    worst = [(item.name, item.level) for item in health_items(told, None)]
    assert ("autopilot", "bad") in worst and ("card", "bad") in worst


def test_a_range_that_is_known_has_no_warning() -> None:
    assert "hardly" not in target_words(TARGET | {"range_m": 10.0, "range_std_m": 1.0, "rivals": 0})
    assert "hardly" in target_words(TARGET | {"range_std_m": None})


def test_a_level_path_tells_no_elevation() -> None:
    flat = dict(person_lines(status(bearing=BEARING | {"elevation_std_deg": None, "azimuth_std_deg": None})))
    assert "elevation not observable" in flat["bearing"] and "deviation not known" in flat["bearing"]


def test_a_beacon_says_that_it_serves() -> None:
    told = {"ok": True, "about": known(role="beacon"), "state": "beacon", "health": health()}
    assert [name for name, _ in person_lines(told)] == ["state", "next"]
    assert {item.level for item in health_items(told, 5000.0)} == {"ok"}
