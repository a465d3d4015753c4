"""What the flight loop writes into the log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.core.inputs import Event
from companion.core.messages import Setpoint, Vector3
from companion.guidance.target import Target, TargetReport
from companion.mission.table import Action, State
from companion.sensing.records import Bearing, Iteration

SERVICE_ENDS: Final = "the service ends"
"""Reason of the last step of every mission, whose state says nothing of the flight."""


@dataclass(frozen=True, slots=True, kw_only=True)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class TagReport:
    """What was made of one sighting of a robot's tag: why it is not believed (empty when it is), where the tag was in
    the autopilot's local frame as far as that could be told, and whether the camera leads to that robot then."""

    t_mono_ns: int
    peer: int
    doubt: str
    p_local_enu_m: Vector3 | None
    leads: bool


def target_report(iteration: Iteration, bearing: Bearing, target: Target) -> TargetReport:
    """What a bearing made of the target."""
    place = target.place(bearing.target_p_enu_m)
    return TargetReport(
        t_mono_ns=bearing.t_mono_ns, peer=iteration.peer, iteration=iteration.number, target=target, p_local_enu_m=place
    )
