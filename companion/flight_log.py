"""What the flight loop writes into the log."""

from __future__ import annotations

from dataclasses import dataclass

from companion.messages import Setpoint
from companion.mission import Action, Event, State


@dataclass(frozen=True, slots=True)
class MissionStep:
    """One transition of the mission, for the log."""

    t_mono_ns: int
    state: State
    event: Event
    next_state: State
    actions: tuple[Action, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class GateReport:
    """A change of what the gate says: the reasons now, none when set points pass again."""

    t_mono_ns: int
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ObservedSetpoint:
    """What would have been sent, and what the gate said to it. Nothing was."""

    t_mono_ns: int
    setpoint: Setpoint
    reasons: tuple[str, ...]
