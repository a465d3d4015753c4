"""The mission as a pure state machine: one table, one step. docs/mission.md shows it, generated from here.

Every way out of our own mode stops the stream and ends in LATCHED (or FAULT): the companion never takes the vehicle
back by itself. Only a person's `engage` leads out of IDLE and LATCHED, and the table has no other way.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Final

from companion.core.inputs import Event


class State(StrEnum):
    IDLE = "idle"
    PREFLIGHT = "preflight"
    TAKING_OFF = "taking_off"
    """Until OFFBOARD is confirmed: climb, then the stream starts and OFFBOARD is asked for."""
    ACQUIRING = "acquiring"
    """In OFFBOARD, moving to gather the first bearing."""
    APPROACHING = "approaching"
    ARRIVED = "arrived"
    """At the target, in the autopilot's own hold."""
    HOLDING = "holding"
    """In OFFBOARD, standing still: the target is silent, our poses are, or aperture after aperture gave no bearing."""
    LANDING = "landing"
    """The autopilot brings it down by itself, here or after its own return."""
    LATCHED = "latched"
    """Hands off until a person engages again."""
    FAULT = "fault"
    """A part of the companion died. Only a restart of the service, which starts idle, leads out."""


AT_REST: Final = frozenset({State.IDLE, State.PREFLIGHT, State.LATCHED, State.FAULT})
"""Nothing flies here by our doing; in all others we fly, or have asked the autopilot to."""


class Action(StrEnum):
    """What the application carries out, in the order given."""

    RUN_PREFLIGHT = "run_preflight"
    ARM_AND_TAKE_OFF = "arm_and_take_off"
    """Does nothing but report `airborne` when the vehicle flies already."""
    STREAM_START = "stream_start"
    REQUEST_OFFBOARD = "request_offboard"
    STREAM_STOP = "stream_stop"
    LEAVE_TO_HOLD = "leave_to_hold"
    LEAVE_AT_TARGET = "leave_at_target"
    """Hold, land or return, as mission.leave says."""
    LEAVE_WITHOUT_TARGET = "leave_without_target"
    """Return or land, as mission.lost_target says."""
    LAND = "land"
    LEAVE_ON_THE_GROUND = "leave_on_the_ground"
    """Out of OFFBOARD, should PX4 go back to it when it disarms."""


Step = tuple[State, tuple[Action, ...]]

_S, _E, _A = State, Event, Action
_LEAVE: Final = (_A.STREAM_STOP, _A.LEAVE_TO_HOLD)
_AT_TARGET: Final = (_A.STREAM_STOP, _A.LEAVE_AT_TARGET)
_DOWN: Final = (_A.STREAM_STOP, _A.LAND)
_STREAMING: Final = (_S.ACQUIRING, _S.APPROACHING, _S.HOLDING)

_COMMON: Final[dict[Event, Step]] = {
    _E.TASK_FAILED: (_S.FAULT, _LEAVE),
    _E.MODE_LOST: (_S.LATCHED, (_A.STREAM_STOP,)),  # nothing else: whoever took over is obeyed
    _E.STALLED: (_S.LATCHED, (_A.STREAM_STOP,)),  # nor here: PX4 takes OFFBOARD back when a lost stream resumes
    _E.LINK_LOST: (_S.LATCHED, (_A.STREAM_STOP,)),
    _E.ABORT: (_S.LATCHED, _LEAVE),
    _E.POSE_LOST: (_S.LANDING, _DOWN),
    _E.BATTERY_LOW: (_S.LANDING, _DOWN),
    _E.BATTERY_UNKNOWN: (_S.LANDING, _DOWN),
    _E.LANDED: (_S.LATCHED, _LEAVE),
    _E.TIMEOUT: (_S.LANDING, _DOWN),
}
"""Of the states in which set points are streamed."""

TABLE: Final[dict[tuple[State, Event], Step]] = {
    (_S.IDLE, _E.ENGAGE): (_S.PREFLIGHT, (_A.RUN_PREFLIGHT,)),
    (_S.IDLE, _E.TASK_FAILED): (_S.FAULT, ()),
    (_S.PREFLIGHT, _E.TASK_FAILED): (_S.FAULT, ()),
    (_S.PREFLIGHT, _E.MODE_LOST): (_S.LATCHED, ()),
    (_S.PREFLIGHT, _E.STALLED): (_S.LATCHED, ()),
    (_S.PREFLIGHT, _E.LINK_LOST): (_S.LATCHED, ()),
    (_S.PREFLIGHT, _E.ABORT): (_S.LATCHED, ()),
    (_S.PREFLIGHT, _E.POSE_LOST): (_S.IDLE, ()),
    (_S.PREFLIGHT, _E.BATTERY_LOW): (_S.IDLE, ()),
    (_S.PREFLIGHT, _E.PREFLIGHT_FAILED): (_S.IDLE, ()),
    (_S.PREFLIGHT, _E.TIMEOUT): (_S.IDLE, ()),
    (_S.PREFLIGHT, _E.PREFLIGHT_PASSED): (_S.TAKING_OFF, (_A.ARM_AND_TAKE_OFF,)),
    # The vehicle still stands on the ground when a take-off begins, so LANDED means nothing there.
    **{(_S.TAKING_OFF, event): step for event, step in _COMMON.items() if event is not _E.LANDED},
    (_S.TAKING_OFF, _E.TIMEOUT): (_S.LATCHED, _LEAVE),
    (_S.TAKING_OFF, _E.TAKEOFF_FAILED): (_S.LATCHED, _LEAVE),
    (_S.TAKING_OFF, _E.AIRBORNE): (_S.TAKING_OFF, (_A.STREAM_START, _A.REQUEST_OFFBOARD)),
    (_S.TAKING_OFF, _E.OFFBOARD_REFUSED): (_S.LATCHED, _LEAVE),
    (_S.TAKING_OFF, _E.OFFBOARD_CONFIRMED): (_S.ACQUIRING, ()),
    **{(state, event): step for state in _STREAMING for event, step in _COMMON.items()},
    # Another robot: the path goes on, and nothing of the one before makes the vehicle arrive or hold.
    **{(state, _E.RETARGET): (_S.ACQUIRING, ()) for state in _STREAMING},
    (_S.ACQUIRING, _E.POSE_STALE): (_S.HOLDING, ()),
    (_S.ACQUIRING, _E.BEARING_STALE): (_S.HOLDING, ()),
    (_S.ACQUIRING, _E.BEARING): (_S.APPROACHING, ()),
    (_S.ACQUIRING, _E.BEARING_BACK): (_S.APPROACHING, ()),
    (_S.ACQUIRING, _E.TARGET_REACHED): (_S.ARRIVED, _AT_TARGET),
    (_S.APPROACHING, _E.POSE_STALE): (_S.HOLDING, ()),
    (_S.APPROACHING, _E.BEARING_STALE): (_S.HOLDING, ()),
    (_S.APPROACHING, _E.TARGET_REACHED): (_S.ARRIVED, _AT_TARGET),
    (_S.HOLDING, _E.BEARING): (_S.APPROACHING, ()),
    (_S.HOLDING, _E.BEARING_BACK): (_S.APPROACHING, ()),
    (_S.HOLDING, _E.TARGET_REACHED): (_S.ARRIVED, _AT_TARGET),
    (_S.HOLDING, _E.TIMEOUT): (_S.LANDING, (_A.STREAM_STOP, _A.LEAVE_WITHOUT_TARGET)),
    (_S.ARRIVED, _E.TASK_FAILED): (_S.FAULT, ()),
    (_S.ARRIVED, _E.MODE_LOST): (_S.LATCHED, ()),
    (_S.ARRIVED, _E.STALLED): (_S.LATCHED, ()),  # there is no stream: it was not we alone that stood still
    (_S.ARRIVED, _E.LINK_LOST): (_S.LATCHED, ()),
    (_S.ARRIVED, _E.ABORT): (_S.LATCHED, ()),
    (_S.ARRIVED, _E.POSE_LOST): (_S.LANDING, (_A.LAND,)),
    (_S.ARRIVED, _E.BATTERY_LOW): (_S.LANDING, (_A.LAND,)),
    (_S.ARRIVED, _E.BATTERY_UNKNOWN): (_S.LANDING, (_A.LAND,)),
    (_S.ARRIVED, _E.TIMEOUT): (_S.LANDING, (_A.LAND,)),
    (_S.ARRIVED, _E.LANDED): (_S.IDLE, (_A.LEAVE_ON_THE_GROUND,)),
    (_S.LANDING, _E.TASK_FAILED): (_S.FAULT, ()),
    (_S.LANDING, _E.MODE_LOST): (_S.LATCHED, ()),
    (_S.LANDING, _E.STALLED): (_S.LATCHED, ()),
    (_S.LANDING, _E.LINK_LOST): (_S.LATCHED, ()),
    (_S.LANDING, _E.ABORT): (_S.LATCHED, ()),  # the autopilot goes on landing; only we let go
    (_S.LANDING, _E.TIMEOUT): (_S.LANDING, (_A.LAND,)),
    (_S.LANDING, _E.LANDED): (_S.IDLE, (_A.LEAVE_ON_THE_GROUND,)),
    (_S.LATCHED, _E.ENGAGE): (_S.PREFLIGHT, (_A.RUN_PREFLIGHT,)),
    (_S.LATCHED, _E.TASK_FAILED): (_S.FAULT, ()),
}
"""What is not listed keeps the state and asks for nothing."""

_SEVERITY: Final = {event: rank for rank, event in enumerate(Event)}


def step(state: State, event: Event) -> Step:
    """The next state and what to do, for every pair."""
    return TABLE.get((state, event), (state, ()))


def worst(state: State, events: Iterable[Event]) -> Event | None:
    """The one event of a tick to act upon: the most severe that means anything in `state`; None if none does.

    The others are dropped: a condition that lasts is raised again next tick, and a wish (`engage`) made while
    something went wrong must be made again, knowingly.
    """
    return min([event for event in events if (state, event) in TABLE], key=_SEVERITY.__getitem__, default=None)
