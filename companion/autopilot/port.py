"""What the rest of the companion may ask of an autopilot. ENU outside, whatever the autopilot speaks inside."""

from __future__ import annotations

from typing import Protocol

from companion.core.messages import AutopilotEvent, Pose, Setpoint, VehicleState
from companion.errors import CompanionError


class AutopilotError(CompanionError):
    """The autopilot is not reachable, or telemetry did not confirm a command in time. Says which and what was seen."""


class GaveWayError(AutopilotError):
    """Somebody else chose another mode while the command ran: it was given up and must not be repeated."""


class Autopilot(Protocol):
    """One vehicle. Commands return once telemetry shows their effect, never on an acknowledgement alone, and raise
    `AutopilotError` otherwise. `state` and `send_setpoint` neither wait nor block."""

    async def connect(self, timeout_s: float = 10.0) -> None:
        """Find the vehicle and wait for its first heartbeat."""

    async def run(self) -> None:
        """Connects, and connects again whenever heartbeats stay away, until cancelled: waits longer after each failure
        and never gives up. Instead of `connect`."""

    @property
    def problem(self) -> str:
        """Why there is no connection; empty while there is one."""

    async def aclose(self) -> None:
        """Let go of the link; bounded in time, and harmless when repeated. Sends no command."""

    def state(self) -> VehicleState:
        """The newest telemetry, stamped now. Its ages are those of arrival, even after the event loop stood still."""

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Send this set point once. Nothing repeats it: when the caller stops, the stream stops."""

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        """Send a pose of our own tracker for the autopilot's estimator. `reset_counter` rises when the tracker began
        anew."""

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None:
        """Say where on Earth the local frame of a vehicle without GPS begins; telemetry shows whether it was taken."""

    def take_events(self) -> list[AutopilotEvent]:
        """What the autopilot said since the last call; the newest hundred."""

    async def arm(self) -> None: ...

    async def takeoff(self, height_m: float) -> None:
        """Climb to `height_m` above the ground. Returns when hovering there; at once if already in the air.

        A hover well below that height is somebody else's decision: GaveWayError.
        """

    async def request_offboard(self) -> None:
        """Hand the vehicle to the set point stream, which must be running. Gives way to any other mode change."""

    async def hold(self) -> None:
        """Leave to the autopilot's own hold mode. Gives way to any other mode change."""

    async def land(self) -> None:
        """Returns when the autopilot is landing; touch-down shows in `state`. Gives way like `hold`."""

    async def return_home(self) -> None:
        """Returns when the autopilot is on its way home, where it lands. Gives way like `hold`."""

    async def parameter(self, name: str) -> int | float:
        """The autopilot's value of one of its parameters."""
