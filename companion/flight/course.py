"""Where the mission stands: its state, since when and why, and what was reported since the last tick."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Final

from companion.core.event_clock import EventClock
from companion.core.inputs import Event
from companion.core.recorder import Recorder
from companion.core.streams import MISSION
from companion.flight.records import SERVICE_ENDS, MissionStep
from companion.mission import table
from companion.mission.table import AT_REST, Action, State

_log = logging.getLogger(__name__)
_WISHES: Final = frozenset({Event.ENGAGE})
_FAILURES: Final = frozenset({Event.PREFLIGHT_FAILED, Event.TAKEOFF_FAILED, Event.OFFBOARD_REFUSED})


class Course:
    """Keeps the state and takes the steps of the table; what they ask for is carried out elsewhere."""

    def __init__(self, clock: EventClock, recorder: Recorder) -> None:
        self._recorder = recorder
        self._state = State.IDLE
        self._since_ns = clock.now_ns()
        self._reason = ""
        self._reported: list[Event] = []

    @property
    def state(self) -> State:
        return self._state

    @property
    def since_ns(self) -> int:
        """When the mission came into its state."""
        return self._since_ns

    @property
    def reason(self) -> str:
        """Of the last step, or why something asked for did not happen; for a person."""
        return self._reason

    def report(self, event: Event | None, reason: str = "") -> None:
        """Something has happened: it counts at the next tick, beside the conditions that hold then."""
        self._reason = reason or self._reason
        if event is Event.ABORT:
            self.withdraw()  # at rest an abort means nothing to the table: what it is about would come after it
        if event is not None:
            self._reported.append(event)

    def withdraw(self) -> None:
        """A person's wish that no tick has taken up yet is not wanted any more."""
        self._reported = [one for one in self._reported if one not in _WISHES]

    def explain(self, reason: str) -> None:
        """Why the next step will be taken; nothing, if there is no reason."""
        self._reason = reason

    def worst(self, conditions: Iterable[Event]) -> Event | None:
        """The worst that holds now or was reported. A report that has no meaning in this state is dropped; one that
        lost against a worse one waits, but for a person's wish, which must then be made again."""
        event = table.worst(self._state, (*conditions, *self._reported))
        waiting = [] if event is None else self._reported
        self._reported = [one for one in waiting if one is not event and one not in _WISHES]
        return event

    def step(self, event: Event, now_ns: int) -> tuple[Action, ...]:
        """Takes the step and records it. What to do, in this order."""
        before = self._state
        self._state, actions = table.step(before, event)
        if self._state is not before:
            self._since_ns = now_ns
            self._reason = f"{event}: {self._reason}" if event in _FAILURES else str(event)
            _log.info("mission: %s -> %s on %s", before, self._state, event)
            if self._state in AT_REST:
                self._reported.clear()  # what was reported of the flight that has ended
        self._record(now_ns, before, event, actions, reason=self._reason)
        return actions

    def end(self, now_ns: int) -> None:
        """The service ends: the last step, whose actions nobody carries out by the table any more."""
        before = self._state
        self._state, actions = table.step(before, Event.TASK_FAILED)
        self._record(now_ns, before, Event.TASK_FAILED, actions, reason=SERVICE_ENDS)

    def _record(self, now_ns: int, before: State, event: Event, actions: tuple[Action, ...], *, reason: str) -> None:
        self._recorder.record(
            MISSION,
            now_ns,
            MissionStep(
                t_mono_ns=now_ns, state=before, event=event, next_state=self._state, actions=actions, reason=reason
            ),
        )
