"""Messages of a log or a feed as the pictures of a page need them: rounded, in degrees, elevation above the horizon.

Messages are the JSON objects of docs/log.md. Azimuths are counter-clockwise from East; places are ENU in the
autopilot's local frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

Message = Mapping[str, Any]
Part = dict[str, Any]


def bearing_part(iteration: Message, t_s: float) -> Part | None:
    """Of an `Iteration`; None where it has no estimate."""
    estimate = iteration["estimate"]
    if estimate is None:
        return None
    sees_azimuth, sees_polar = estimate.get("azimuth_observable", True), estimate.get("polar_observable", True)
    return {
        "t_s": round(t_s, 2),
        "number": iteration["number"],
        "peer": iteration["peer"],
        "p_m": _rounded(iteration.get("p_local_enu_m")),
        "azimuth_deg": degrees(estimate["azimuth_rad"]),
        "azimuth_std_deg": degrees(estimate.get("azimuth_std_rad")) if sees_azimuth else None,
        "elevation_deg": elevation_deg(estimate["polar_rad"]) if sees_polar else None,
        "elevation_std_deg": degrees(estimate.get("polar_std_rad")) if sees_polar else None,
        "reliability": round(estimate["reliability"], 2),
        "packets": estimate["packets"],
        "length_m": round(estimate["length_m"], 2),
        "others": [_other(path) for path in estimate.get("paths", ())[1:]] + _twins(estimate),
    }


def refusal_part(iteration: Message, t_s: float) -> Part:
    """Of an `Iteration` without an estimate."""
    return {"t_s": round(t_s, 2), "number": iteration["number"], "peer": iteration["peer"], "why": iteration["refusal"]}


def target_part(report: Message, t_s: float) -> Part:
    """Of a `TargetReport`. Rivals are places of the same moment as the target's. In old logs it may have no place."""
    target, place = report["target"], report["p_local_enu_m"]
    moved = [p - o for p, o in zip(place, target["origin_local_enu_m"], strict=True)] if place is not None else []
    rivals = [
        {
            "p_m": _rounded([o + m for o, m in zip(rival["origin_local_enu_m"], moved, strict=True)]),
            "probability": round(rival["probability"], 2),
        }
        for rival in target.get("rivals", ())
        if place is not None
    ]
    return {
        "t_s": round(t_s, 2),
        "peer": report["peer"],
        "p_m": _rounded(place),
        "range_m": _round(target["range_m"], 1),
        "range_std_m": _round(target["range_std_m"], 1),
        "azimuth_deg": degrees(target["azimuth_rad"]),
        "probability": _round(target.get("probability"), 2),
        "ellipse": _ellipse(target.get("covariance_m2")),
        "rivals": rivals,
    }


def vehicle_part(state: Message, t_ns: int) -> Part:
    """Of a `VehicleState` at `t_ns`."""
    heard_ns = state.get("heartbeat_mono_ns")
    return {
        "name": vehicle_name(state),
        "mode": state.get("mode"),
        "armed": bool(state.get("armed")),
        "in_air": None if state.get("landed_unknown") else bool(state.get("in_air")),
        "failsafe": bool(state.get("failsafe")),
        "p_m": _rounded(state.get("p_local_enu_m")),
        "v_m_s": _rounded(state.get("v_local_enu_m_s")),
        "yaw_deg": degrees(state.get("yaw_enu_rad")),
        "battery": _round(state.get("battery_remaining"), 2),
        "heartbeat_age_s": None if heard_ns is None else round(max(0.0, (t_ns - heard_ns) / 1e9), 1),
    }


def vehicle_name(state: Message) -> str:
    """Which vehicle this is: its system id, what it says it is, its firmware."""
    if state.get("system_id") is None:
        return state.get("autopilot") or "vehicle"
    return " ".join(f"system {state['system_id']}, {state['autopilot'] or 'unknown'} {state['firmware']}".split())


def degrees(angle_rad: float | None) -> float | None:
    """To a tenth; None for what is not known."""
    return None if angle_rad is None or not math.isfinite(angle_rad) else round(math.degrees(angle_rad), 1)


def elevation_deg(polar_rad: float) -> float:
    """Above the horizon, of an angle from the zenith: the one vertical angle that a person is shown."""
    return round(90.0 - math.degrees(polar_rad), 1)


def compass_deg(azimuth_deg: float) -> float:
    """Clockwise from North in [0, 360), of an azimuth counter-clockwise from East."""
    return (90.0 - azimuth_deg) % 360.0


def _other(path: Message) -> Part:
    return {"azimuth_deg": degrees(path["azimuth_rad"]), "share": round(path["relative_power"], 2)}


def _twins(estimate: Message) -> list[Part]:
    """What the aperture cannot tell from its bearing, as far as it is another azimuth."""
    return [{"azimuth_deg": degrees(one["azimuth_rad"]), "share": 1.0} for one in estimate.get("alternatives", ())[:1]]


def _ellipse(covariance_m2: Sequence[Sequence[float]] | None) -> Part | None:
    """Of one deviation over the ground: its half axes [m], the major one's direction from East [deg]."""
    if covariance_m2 is None:
        return None
    (a, b, _), (_, d, _), _ = covariance_m2
    mean, half = (a + d) / 2, math.hypot((a - d) / 2, b)
    return {
        "major_m": round(math.sqrt(max(0.0, mean + half)), 2),
        "minor_m": round(math.sqrt(max(0.0, mean - half)), 2),
        "turn_deg": round(math.degrees(math.atan2(2 * b, a - d) / 2), 1),
    }


def _rounded(p_m: Sequence[float] | None) -> list[float] | None:
    return None if p_m is None else [round(value, 2) for value in p_m]


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
