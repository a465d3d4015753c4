"""What the vehicle tells of itself, once a tick: to the flight, and to the log, the apertures and North."""

from __future__ import annotations

from typing import Final

from companion.autopilot.port import Autopilot
from companion.core.clock import age_s
from companion.core.messages import VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import AUTOPILOT_EVENT
from companion.pose.intake import PoseIntake
from companion.sensing.iterations import SarIterations

_HEADING_S: Final = 0.5


class VehicleFeed:
    def __init__(self, autopilot: Autopilot, sar: SarIterations, intake: PoseIntake, recorder: Recorder) -> None:
        self._autopilot = autopilot
        self._sar = sar
        self._intake = intake
        self._recorder = recorder

    def take(self, now_ns: int) -> VehicleState:
        """Its newest state, handed on."""
        vehicle = self._autopilot.state()
        for event in self._autopilot.take_events():
            self._recorder.record(AUTOPILOT_EVENT, event.t_mono_ns, event)
        if vehicle.p_local_enu_m is not None and vehicle.position_mono_ns is not None:
            self._sar.add_local_position(vehicle.position_mono_ns, vehicle.p_local_enu_m)
        if vehicle.yaw_enu_rad is not None and age_s(vehicle.position_mono_ns, now_ns) < _HEADING_S:
            self._intake.add_heading(now_ns, vehicle.yaw_enu_rad)
        return vehicle
