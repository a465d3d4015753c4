"""What a pilot is told of the flight, and how much of it at most. Pure but for the recorder behind it.

Sentences are made of what is recorded anyway, so nothing in the flight knows of them. How many go out is bounded by
constants: they share a link with the set points, and whatever happens a thousand times a second must not.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Any, Final

from companion.autopilot.ground_station import chunks
from companion.core.clock import NS_PER_S
from companion.core.inputs import CommandOutcome, Wish
from companion.core.recorder import Recorder
from companion.core.streams import COMMAND, GATE, MISSION, WISH, Stream
from companion.flight.records import SERVICE_ENDS, GateReport, MissionStep
from companion.mission.table import AT_REST, State

WAITING: Final = 16
BURST: Final = 8
"""Messages at once after a silence,"""
PER_S: Final = 2
"""and so many a second from then on."""
AGAIN_S: Final = 10.0
"""The same words are not said more often than this."""
_CRITICAL, _WARNING, _NOTICE = 2, 4, 5
_SEVERITY: Final = {State.FAULT: _CRITICAL, State.LATCHED: _WARNING, State.LANDING: _WARNING, State.HOLDING: _WARNING}


@dataclass(frozen=True, slots=True)
class Announcement:
    severity: int
    """As in syslog: 2 critical, 4 warning, 5 notice."""
    text: str
    is_step: bool = False
    """A change of the mission's state."""


class Announcements:
    """A Recorder before another one, which hears what a pilot should. Asked by `due`."""

    def __init__(self, inner: Recorder) -> None:
        self._inner = inner
        self._waiting: deque[Announcement] = deque()
        self._said: dict[str, int] = {}
        self._budget = float(BURST)
        self._asked_ns: int | None = None
        self._gate_is_open = True
        self.dropped = 0
        """Sentences of which nothing was said: more came than may be sent."""
        self._untold = 0

    @property
    def failed(self) -> bool:
        return self._inner.failed

    def counters(self) -> dict[str, int]:
        return self._inner.counters()

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        self._inner.record(stream, t_mono_ns, message)
        if stream is MISSION:
            self._step(message, t_mono_ns)
        elif stream is WISH:
            self._wish(message, t_mono_ns)
        elif stream is COMMAND:
            self._outcome(message, t_mono_ns)
        elif stream is GATE:
            self._gate(message, t_mono_ns)

    def due(self, now_ns: int) -> list[Announcement]:
        """What may be said now: changes of state first, then the oldest."""
        passed_s = 0.0 if self._asked_ns is None else (now_ns - self._asked_ns) / NS_PER_S
        self._asked_ns = now_ns
        self._budget = min(float(BURST), self._budget + PER_S * passed_s)
        due = []
        while self._waiting:
            next_one = next((waits for waits in self._waiting if waits.is_step), self._waiting[0])
            text = (f"({self._untold} not told) " if self._untold else "") + next_one.text
            cost = len(chunks(text))
            if cost > self._budget:
                break
            self._budget -= cost
            self._waiting.remove(next_one)
            due.append(replace(next_one, text=text))
            self._untold = 0
        return due

    def _step(self, step: MissionStep, now_ns: int) -> None:
        if step.reason == SERVICE_ENDS:
            self._add(Announcement(_WARNING, "companion: the service ends", is_step=True), now_ns)
        elif step.next_state is not step.state:
            who = "companion" if step.next_state in AT_REST else "companion flies"
            text = f"{who}: {step.next_state} ({step.reason})"
            self._add(Announcement(_SEVERITY.get(step.next_state, _NOTICE), text, is_step=True), now_ns)

    def _wish(self, wish: Wish, now_ns: int) -> None:
        if wish.refusal:
            self._add(Announcement(_WARNING, f"companion: {wish.wish} refused: {wish.refusal}"), now_ns)

    def _outcome(self, outcome: CommandOutcome, now_ns: int) -> None:
        if outcome.error:
            self._add(Announcement(_WARNING, f"companion: {outcome.error}"), now_ns)

    def _gate(self, report: GateReport, now_ns: int) -> None:
        opened, self._gate_is_open = not self._gate_is_open, not report.reasons
        if report.reasons:
            self._add(Announcement(_WARNING, f"companion: gate holds: {'; '.join(report.reasons)}"), now_ns)
        elif opened:
            self._add(Announcement(_NOTICE, "companion: gate passes again"), now_ns)

    def _add(self, one: Announcement, now_ns: int) -> None:
        """A change of state is never left out for what was said before, and takes the place of another sentence."""
        if not one.is_step and now_ns - self._said.get(one.text, -(1 << 62)) < AGAIN_S * NS_PER_S:
            return
        if len(self._waiting) >= WAITING:
            self.dropped += 1
            self._untold += 1
            if not one.is_step:
                return
            self._waiting.remove(next((waits for waits in self._waiting if not waits.is_step), self._waiting[0]))
        self._said = {text: t_ns for text, t_ns in self._said.items() if now_ns - t_ns < AGAIN_S * NS_PER_S}
        self._said[one.text] = now_ns
        self._waiting.append(one)


def named_values(status: dict[str, Any]) -> dict[str, float | None]:
    """What a ground station is shown, of a status as `companion status` has it; None for what is not known. A bearing
    that is stale is not known."""
    bearing, target = status["bearing"], status["target"]
    bearing = None if status["bearing_stale"] else bearing
    return {
        "wsr_state": float(list(State).index(State(status["state"]))),
        "wsr_brg": None if bearing is None else (90.0 - bearing["azimuth_deg"]) % 360.0,
        "wsr_brg_sd": None if bearing is None else _finite(bearing["azimuth_std_deg"]),
        "wsr_rel": None if bearing is None else bearing["reliability"],
        "wsr_range": None if target is None else _finite(target["range_m"]),
        "wsr_rng_sd": None if target is None else _finite(target["range_std_m"]),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
