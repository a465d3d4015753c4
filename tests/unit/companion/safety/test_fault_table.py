"""The table of faults is complete."""

from __future__ import annotations

from companion.core.inputs import Event
from companion.mission.table import TABLE, Action
from companion.safety.fault_table import FAULTS


def test_every_fault_names_detection_and_clearance_and_every_event_that_stops_the_stream_is_one() -> None:
    stopping = {event for (_, event), (_, actions) in TABLE.items() if Action.STREAM_STOP in actions}
    assert stopping - set(FAULTS) == {Event.TARGET_REACHED}
    for fault in FAULTS.values():
        assert fault.within and fault.noticed_by and fault.cleared_by
    assert list(FAULTS) == [event for event in Event if event in FAULTS], "in order of severity"
