"""The autopilot as the log sees it: what its state was when a decision looked at it."""

from __future__ import annotations

from companion.autopilot.port import Autopilot
from companion.core.event_clock import EventClock
from companion.core.messages import AutopilotEvent, Pose, Setpoint, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import VEHICLE


class ObservedAutopilot:
    """Another `Autopilot`, whose state stands still while one event is handled and is recorded with it.

    Commands run outside events and see the newest state.
    """

    def __init__(self, autopilot: Autopilot, clock: EventClock, recorder: Recorder) -> None:
        self._autopilot = autopilot
        self._clock = clock
        self._recorder = recorder
        self._seen: tuple[int, VehicleState] | None = None

    def state(self) -> VehicleState:
        if not self._clock.is_held:
            return self._autopilot.state()
        if self._seen is None or self._seen[0] != self._clock.number:
            state = self._autopilot.state()
            self._seen = self._clock.number, state
            self._recorder.record(VEHICLE, self._clock.now_ns(), state)
        return self._seen[1]

    @property
    def problem(self) -> str:
        return self._autopilot.problem

    def take_events(self) -> list[AutopilotEvent]:
        return self._autopilot.take_events()

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        self._autopilot.send_odometry(pose, reset_counter)

    async def run(self) -> None:
        await self._autopilot.run()

    async def return_home(self) -> None:
        await self._autopilot.return_home()

    async def connect(self, timeout_s: float = 10.0) -> None:
        await self._autopilot.connect(timeout_s)

    async def aclose(self) -> None:
        await self._autopilot.aclose()

    def send_setpoint(self, setpoint: Setpoint) -> None:
        self._autopilot.send_setpoint(setpoint)

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

    async def parameter(self, name: str) -> int | float:
        return await self._autopilot.parameter(name)
