"""The autopilot as the log sees it: what its state was when a decision looked at it."""

from __future__ import annotations

from companion.autopilot.delegating import DelegatingAutopilot
from companion.autopilot.port import Autopilot
from companion.core.event_clock import EventClock
from companion.core.messages import VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import VEHICLE


class SnapshotAutopilot(DelegatingAutopilot):
    """Another `Autopilot`, whose state stands still while one event is handled and is recorded with it.

    Commands run outside events and see the newest state.
    """

    def __init__(self, autopilot: Autopilot, clock: EventClock, recorder: Recorder) -> None:
        super().__init__(autopilot)
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
