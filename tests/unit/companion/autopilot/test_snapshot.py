"""A vehicle whose state stands still while one event is handled."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from companion.autopilot.port import Autopilot
from companion.autopilot.snapshot import SnapshotAutopilot
from companion.core.event_clock import EventClock
from companion.core.messages import VehicleState
from companion.core.streams import VEHICLE
from tests.kept import Kept
from tests.manual_clock import ManualClock


class _Moving:
    """Another state each time it is asked."""

    def __init__(self) -> None:
        self.asked = 0

    def state(self) -> VehicleState:
        self.asked += 1
        return replace(VehicleState(t_mono_ns=0), t_mono_ns=self.asked)


def test_each_event_sees_one_state_and_records_it_once() -> None:
    clock, kept = EventClock(ManualClock(5000)), Kept()
    autopilot = SnapshotAutopilot(cast(Autopilot, _Moving()), clock, kept)
    assert (autopilot.state().t_mono_ns, autopilot.state().t_mono_ns) == (1, 2), "outside events the newest"
    assert kept.messages == []
    with clock.event(7000):
        assert (autopilot.state().t_mono_ns, autopilot.state().t_mono_ns) == (3, 3)
    with clock.event(8000):
        assert autopilot.state().t_mono_ns == 4
    assert [(stream is VEHICLE, t_ns, state.t_mono_ns) for stream, t_ns, state in kept.messages] == [
        (True, 7000, 3),
        (True, 8000, 4),
    ]
