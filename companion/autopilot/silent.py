"""An autopilot that is heard and never commanded."""

from __future__ import annotations

from companion.autopilot.delegating import DelegatingAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.messages import Setpoint


class SilentAutopilot(DelegatingAutopilot):
    """Another `Autopilot`, heard and never commanded: the second barrier behind the refusal to engage. Our poses
    and their origin go on: the estimator's input is no command, and without it a pilot could not fly without GPS."""

    def send_setpoint(self, setpoint: Setpoint) -> None:
        raise _refused("a set point")

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
