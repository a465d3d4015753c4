"""Observe mode: somebody else flies or carries the vehicle, and everything is computed but nothing is sent."""

from __future__ import annotations

import math

from companion.autopilot.port import Autopilot, AutopilotError
from companion.clock import NS_PER_S
from companion.config import ApertureConfig, MissionConfig
from companion.messages import AutopilotEvent, Pose, Setpoint, Vector3, VehicleState
from companion.sar import SarIterations

_LONGEST_S = 20.0
_LOOK_S = 0.5
_LEAD_S = 0.5


class SilentAutopilot:
    """An `Autopilot` that hears and never commands: the second barrier behind the refusal to engage."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot

    @property
    def problem(self) -> str:
        return self._autopilot.problem

    async def connect(self, timeout_s: float = 10.0) -> None:
        await self._autopilot.connect(timeout_s)

    async def run(self) -> None:
        await self._autopilot.run()

    async def aclose(self) -> None:
        await self._autopilot.aclose()

    def state(self) -> VehicleState:
        return self._autopilot.state()

    def take_events(self) -> list[AutopilotEvent]:
        return self._autopilot.take_events()

    async def parameter(self, name: str) -> int | float:
        return await self._autopilot.parameter(name)

    def send_setpoint(self, setpoint: Setpoint) -> None:
        raise _refused("a set point")

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        """The estimator's input is no command: without it a pilot could not fly where there is no GPS."""
        self._autopilot.send_odometry(pose, reset_counter)

    async def arm(self) -> None:
        raise _refused("arming")

    async def takeoff(self, height_m: float) -> None:
        raise _refused("takeoff")

    async def request_offboard(self) -> None:
        raise _refused("OFFBOARD")

    async def hold(self) -> None:
        raise _refused("hold")

    async def land(self) -> None:
        raise _refused("land")

    async def return_home(self) -> None:
        raise _refused("return")


class Observer:
    """Cuts the motion of whoever moves the vehicle into SAR iterations."""

    def __init__(self, sar: SarIterations, config: ApertureConfig) -> None:
        self._sar = sar
        self._config = config
        self._began_ns = 0
        self._looked_ns = 0
        self._ended_ns: int | None = None

    def tick(self, now_ns: int) -> None:
        """A path as long as a leg ends an iteration, and so does a long time without one."""
        if self._ended_ns is not None:
            if now_ns - self._ended_ns >= self._config.settle_s * NS_PER_S:
                self._sar.finish(self._ended_ns)
                self._ended_ns = None
        elif self._sar.start_ns is None:
            if not self._sar.is_waiting:
                self._sar.begin()
                self._began_ns = now_ns
        elif now_ns - self._looked_ns >= _LOOK_S * NS_PER_S:
            self._looked_ns = now_ns
            is_long = self._sar.path_length_m() >= self._config.length_m
            if is_long or now_ns - self._began_ns >= _LONGEST_S * NS_PER_S:
                self._ended_ns = now_ns


def would_be_setpoint(now_ns: int, p_local_enu_m: Vector3, azimuth_rad: float, mission: MissionConfig) -> Setpoint:
    """The set point that a leg to the target would begin with: for the log, and judged by the gate like any other."""
    vx, vy = mission.speed_m_s * math.cos(azimuth_rad), mission.speed_m_s * math.sin(azimuth_rad)
    x, y, _ = p_local_enu_m
    return Setpoint(now_ns, (x + _LEAD_S * vx, y + _LEAD_S * vy, mission.takeoff_height_m), (vx, vy, 0.0), azimuth_rad)


def _refused(what: str) -> AutopilotError:
    return AutopilotError(f"{what} was not sent: the service observes (mission.control)")
