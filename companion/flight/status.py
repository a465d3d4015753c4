"""What is going on, for a person. Pure."""

from __future__ import annotations

import math
from typing import Any

from companion.core.messages import VehicleState
from companion.flight.course import Course
from companion.flight.knowledge import Knowledge
from companion.sensing.records import Iteration


def status(
    *,
    course: Course,
    knowledge: Knowledge,
    vehicle: VehicleState,
    control: str,
    not_ready: list[str],
    path_m: float,
    streaming: bool,
    overruns: int,
) -> dict[str, Any]:
    """Angles in degrees; `path_m` is flown since the iteration began."""
    target = knowledge.targets.target
    return {
        "state": course.state,
        "control": control,
        "reason": course.reason,
        "not_ready": not_ready,
        "packets": knowledge.packets,
        "path_m": path_m,
        "bearing": _bearing(knowledge.iteration),
        "bearing_stale": knowledge.is_stale(),
        "target_range_m": target.range_m if target is not None and math.isfinite(target.range_m) else None,
        "streaming": streaming,
        "vehicle": _vehicle(vehicle),
        "overruns": overruns,
    }


def _bearing(iteration: Iteration | None) -> dict[str, Any] | None:
    if iteration is None or iteration.estimate is None:
        return None
    estimate = iteration.estimate
    return {
        "azimuth_deg": math.degrees(estimate.azimuth_rad),
        "elevation_deg": 90.0 - math.degrees(estimate.polar_rad),
        "reliability": estimate.reliability,
        "iteration": iteration.number,
        "reference_ns": iteration.reference_ns,
    }


def _vehicle(state: VehicleState) -> dict[str, Any]:
    return {
        "system_id": state.system_id,
        "autopilot": state.autopilot,
        "firmware": state.firmware,
        "mode": state.mode,
        "intended_mode": state.intended_mode,
        "armed": state.armed,
        "can_arm": state.can_arm,
        "in_air": state.in_air,
        "p_local_enu_m": state.p_local_enu_m,
        "v_local_enu_m_s": state.v_local_enu_m_s,
        "yaw_enu_rad": state.yaw_enu_rad,
        "battery": state.battery_remaining,
        "position_is_global": state.position_is_global,
    }


def vehicle_name(state: VehicleState) -> str:
    """Which vehicle this is: its system id, what it says it is, its firmware."""
    if state.system_id is None:
        return "no vehicle"
    return " ".join(f"system {state.system_id}, {state.autopilot or 'unknown'} {state.firmware}".split())
