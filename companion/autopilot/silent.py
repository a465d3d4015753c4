"""An autopilot that is heard and never commanded."""

from __future__ import annotations

from companion.autopilot.port import Autopilot, AutopilotError
from companion.core.messages import AutopilotEvent, Pose, Setpoint, VehicleState


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


def _refused(what: str) -> AutopilotError:
    return AutopilotError(f"{what} was not sent: the service observes (mission.control)")
