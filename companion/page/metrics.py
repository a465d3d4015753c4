"""The same numbers for Prometheus: its text format 0.0.4, base units, names that end in their unit or in _total."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from companion.page.model import Model

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
_STATES: Final = (
    "idle", "preflight", "taking_off", "acquiring", "approaching", "arrived", "holding", "landing", "latched", "fault",
)  # fmt: skip
_TOPICS: Final = {"/csi": "packets", "/pose/in": "poses", "/neighbour": "datagrams", "/setpoint": "setpoints"}
_Sample = tuple[Mapping[str, str], float | None]


def metrics_text(model: Model, silent_s: float, viewers: int, dropped: int) -> str:
    """Every family with its help and type; a number that is not known is left out."""
    lines = []
    for name, kind, help_text, samples in _families(model, silent_s, viewers, dropped):
        known = [(labels, value) for labels, value in samples if value is not None]
        if known:
            lines += [f"# HELP {name} {help_text}", f"# TYPE {name} {kind}"]
            lines += [f"{name}{_labels(labels)} {value:.10g}" for labels, value in known]
    return "\n".join(lines) + "\n"


def _families(
    model: Model, silent_s: float, viewers: int, dropped: int
) -> Iterator[tuple[str, str, str, list[_Sample]]]:
    yield "companion_feed_silence_seconds", "gauge", "Since the service last told anything.", [({}, silent_s)]
    yield "companion_page_viewers", "gauge", "Browsers that look at the page.", [({}, viewers)]
    yield (
        "companion_page_frames_dropped_total",
        "counter",
        "Messages that the page did not take in time.",
        [({}, dropped)],
    )
    yield from _inputs(model)
    yield from _vehicle(model)
    yield from _target(model)
    levels = [item.level for item in model.items(silent_s)]
    yield (
        "companion_health_items",
        "gauge",
        "Lines of the health list.",
        [({"level": level}, levels.count(level)) for level in ("bad", "warning", "ok")],
    )


def _inputs(model: Model) -> Iterator[tuple[str, str, str, list[_Sample]]]:
    counts, health = model.counts, model.health or {}
    yield (
        "companion_messages_total",
        "counter",
        "Messages since the service began.",
        [({"kind": kind}, counts.get(topic)) for topic, kind in _TOPICS.items()],
    )
    yield "companion_pose_age_seconds", "gauge", "Age of the newest pose.", [({}, health.get("pose_age_s"))]
    radio = health.get("radio", {})
    yield (
        "companion_card_lost_total",
        "counter",
        "Packets that the driver counted and nobody saw.",
        [({}, radio.get("lost"))],
    )
    neighbours = health.get("neighbours", {}).items()
    for key, name, help_text in (
        ("age_s", "companion_neighbour_age_seconds", "Age of a neighbour's newest datagram."),
        ("pairing_rate", "companion_neighbour_paired_ratio", "Share of a neighbour's packets that were paired."),
        ("clock_uncertainty_s", "companion_neighbour_clock_uncertainty_seconds", "Of its clock's relation to ours."),
    ):
        yield name, "gauge", help_text, [({"neighbour": peer}, one.get(key)) for peer, one in neighbours]
    recorder = health.get("recorder", {})
    yield (
        "companion_log_messages_total",
        "counter",
        "Messages of the log.",
        [({"outcome": key}, recorder.get(key)) for key in ("written", "dropped", "malformed")],
    )
    yield "companion_log_failures_total", "counter", "Times the disk failed.", [({}, recorder.get("failures"))]
    free = None if model.free_mib is None else model.free_mib * (1 << 20)
    yield "companion_log_disk_free_bytes", "gauge", "Free space on the log's disk.", [({}, free)]


def _vehicle(model: Model) -> Iterator[tuple[str, str, str, list[_Sample]]]:
    if model.known.get("role") == "uav":
        yield (
            "companion_mission_state",
            "gauge",
            "1 for the state the mission is in.",
            [({"state": state}, float(state == model.state)) for state in _STATES],
        )
    vehicle = model.vehicle
    if vehicle is None:
        return
    yield (
        "companion_vehicle_battery_ratio",
        "gauge",
        "Charge of the emptiest battery.",
        [({}, vehicle.get("battery_remaining"))],
    )
    yield "companion_vehicle_armed", "gauge", "Whether it is armed.", [({}, float(vehicle.get("armed", False)))]
    place = vehicle.get("p_local_enu_m") or (None, None, None)
    yield (
        "companion_vehicle_position_meters",
        "gauge",
        "In its local frame, ENU.",
        [({"axis": axis}, value) for axis, value in zip(("east", "north", "up"), place, strict=True)],
    )


def _target(model: Model) -> Iterator[tuple[str, str, str, list[_Sample]]]:
    bearing, target = model.bearing, model.target
    if bearing is not None:
        yield (
            "companion_bearing_azimuth_degrees",
            "gauge",
            "Of the newest bearing, counter-clockwise from East.",
            [({}, bearing["azimuth_deg"])],
        )
        yield "companion_bearing_reliability_ratio", "gauge", "Of the newest bearing.", [({}, bearing["reliability"])]
    if target is not None:
        yield "companion_target_range_meters", "gauge", "From the newest bearing's place.", [({}, target["range_m"])]
        yield "companion_target_range_deviation_meters", "gauge", "One deviation of it.", [({}, target["range_std_m"])]


def _labels(labels: Mapping[str, Any]) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{key}="{_escaped(str(value))}"' for key, value in labels.items()) + "}"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
