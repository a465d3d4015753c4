"""What is going on, for a person. Pure."""

from __future__ import annotations

import math
from typing import Any

from companion.core.clock import age_s
from companion.core.messages import VehicleState
from companion.flight.course import Course
from companion.flight.knowledge import Knowledge
from companion.guidance.target import Target
from companion.neighbours.neighbour import Neighbour
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
    target, packet_age_s = knowledge.targets.target, knowledge.packet_age_s()
    return {
        "state": course.state,
        "control": control,
        "reason": course.reason,
        "not_ready": not_ready,
        "packets": knowledge.packets,
        "packet_age_s": packet_age_s if math.isfinite(packet_age_s) else None,
        "path_m": path_m,
        "bearing": _bearing(knowledge.iteration),
        "bearing_stale": knowledge.is_stale(),
        "target_range_m": None if target is None else _finite(target.range_m),
        "target": None if target is None else _target(target),
        "target_id": knowledge.neighbour.id,
        "target_name": knowledge.neighbour.name,
        "robots": [_robot(knowledge, robot) for robot in knowledge.robots],
        "camera": None if knowledge.camera is None else knowledge.camera.status(knowledge.neighbour.id),
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
        "azimuth_std_deg": _degrees(estimate.azimuth_std_rad),
        "elevation_deg": 90.0 - math.degrees(estimate.polar_rad),
        "elevation_std_deg": _degrees(estimate.polar_std_rad) if estimate.polar_observable else None,
        "reliability": estimate.reliability,
        "iteration": iteration.number,
        "reference_ns": iteration.reference_ns,
    }


def _target(target: Target) -> dict[str, Any]:
    return {
        "range_m": _finite(target.range_m),
        "range_std_m": _finite(target.range_std_m),
        "range_90_m": list(target.whole.range_90_m),
        "azimuth_deg": math.degrees(target.azimuth_rad),
        "probability": target.probability,
        "rivals": len(target.rivals),
    }


def _robot(knowledge: Knowledge, robot: Neighbour) -> dict[str, Any]:
    """One that may be flown to: whether it is heard, and what is known of where it is."""
    found = knowledge.targets.found(robot.id)
    return {
        "id": robot.id,
        "name": robot.name,
        "packet_age_s": _finite(knowledge.packet_age_s(robot.id)),
        "datagram_age_s": _finite(knowledge.datagram_age_s(robot.id)),
        "place": None if found is None else _target(found),
    }


def _degrees(std_rad: float) -> float | None:
    return math.degrees(std_rad) if math.isfinite(std_rad) else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


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
        "landed_unknown": state.landed_unknown,
        "p_local_enu_m": state.p_local_enu_m,
        "v_local_enu_m_s": state.v_local_enu_m_s,
        "yaw_enu_rad": state.yaw_enu_rad,
        "battery": state.battery_remaining,
        "failsafe": state.failsafe,
        "estimator_healthy": state.estimator_healthy,
        "heartbeat_age_s": _finite(age_s(state.heartbeat_mono_ns, state.t_mono_ns)),
        "position_is_global": state.position_is_global,
    }


def vehicle_name(state: VehicleState) -> str:
    """Which vehicle this is: its system id, what it says it is, its firmware."""
    if state.system_id is None:
        return "no vehicle"
    return " ".join(f"system {state.system_id}, {state.autopilot or 'unknown'} {state.firmware}".split())
