"""Observe mode: somebody else flies or carries the vehicle, and everything is computed but nothing is sent. What would
have been sent is written down.
"""

from __future__ import annotations

import math

from companion.config.schema import MissionConfig
from companion.core.messages import Setpoint, Vector3, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import OBSERVED
from companion.flight.local_frame import LocalFrame
from companion.flight.records import ObservedSetpoint
from companion.guidance.ground import in_plane
from companion.guidance.targets import Targets
from companion.safety.gate import Gate

_LEAD_S = 0.5


class Observer:
    def __init__(
        self, *, mission: MissionConfig, gate: Gate, targets: Targets, frame: LocalFrame, recorder: Recorder
    ) -> None:
        self._mission = mission
        self._gate = gate
        self._targets = targets
        self._frame = frame
        self._recorder = recorder

    def note(self, vehicle: VehicleState, now_ns: int) -> None:
        """Records what would be sent at this tick, and what the gate says to it."""
        target, p_m, ground_m = self._targets.target, vehicle.p_local_enu_m, self._frame.ground_m
        if target is None or p_m is None:
            return
        wanted = would_be_setpoint(
            now_ns, p_m, target.azimuth_rad, self._mission, height_m=ground_m + self._mission.takeoff_height_m
        )
        if self._mission.vehicle == "rover":
            wanted = in_plane(wanted, p_m, self._gate.limits)
        verdict = self._gate.check(wanted, vehicle, now_ns, True, neighbours=self._targets.places(), ground_m=ground_m)
        self._recorder.record(OBSERVED, now_ns, ObservedSetpoint(now_ns, wanted, verdict.reasons))


def would_be_setpoint(
    now_ns: int, p_local_enu_m: Vector3, azimuth_rad: float, mission: MissionConfig, *, height_m: float
) -> Setpoint:
    """The set point that a flight to the target would begin with: for the log, judged by the gate like any other."""
    vx, vy = mission.speed_m_s * math.cos(azimuth_rad), mission.speed_m_s * math.sin(azimuth_rad)
    x, y, _ = p_local_enu_m
    return Setpoint(now_ns, (x + _LEAD_S * vx, y + _LEAD_S * vy, height_m), (vx, vy, 0.0), azimuth_rad)
