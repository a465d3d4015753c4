"""An autopilot that hands everything on: what stands before another one changes only what it is there for."""

from __future__ import annotations

from companion.autopilot.port import Autopilot
from companion.core.messages import AutopilotEvent, Pose, Setpoint, VehicleState


class DelegatingAutopilot:
    """Every method of the port, answered by `autopilot`."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot

    async def connect(self, timeout_s: float = 10.0) -> None:
        await self._autopilot.connect(timeout_s)

    async def run(self) -> None:
        await self._autopilot.run()

    @property
    def problem(self) -> str:
        return self._autopilot.problem

    async def aclose(self) -> None:
        await self._autopilot.aclose()

    def state(self) -> VehicleState:
        return self._autopilot.state()

    def send_setpoint(self, setpoint: Setpoint) -> None:
        self._autopilot.send_setpoint(setpoint)

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        self._autopilot.send_odometry(pose, reset_counter)

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None:
        self._autopilot.set_origin(latitude_deg, longitude_deg)

    def take_events(self) -> list[AutopilotEvent]:
        return self._autopilot.take_events()

    async def arm(self) -> None:
        await self._autopilot.arm()

    async def takeoff(self, height_m: float) -> None:
        await self._autopilot.takeoff(height_m)

    async def request_offboard(self) -> None:
        await self._autopilot.request_offboard()

    async def hold(self) -> None:
        await self._autopilot.hold()

    async def land(self) -> None:
        await self._autopilot.land()

    async def return_home(self) -> None:
        await self._autopilot.return_home()

    async def parameter(self, name: str) -> int | float:
        return await self._autopilot.parameter(name)
