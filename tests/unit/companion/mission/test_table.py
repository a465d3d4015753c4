"""The mission table, pair by pair, and the document that shows it."""

from __future__ import annotations

import pytest

from companion.core.inputs import Event
from companion.mission.table import TABLE, Action, State, step, worst

STREAM_STATES = {State.TAKING_OFF, State.ACQUIRING, State.APPROACHING, State.HOLDING}
"""States in which set points may go out (in TAKING_OFF only after STREAM_START)."""

_STREAMING = (State.ACQUIRING, State.APPROACHING, State.HOLDING)
_FLYING = (State.TAKING_OFF, *_STREAMING)
# Written down a second time, from what the mission must do rather than from how the table is built: state by state,
# "event > next state" and the actions' initials (p preflight, t take off, s start, o offboard, x stop, h hold, l land,
# a leave at the target, w leave without it).
_EXPECTED = {
    State.IDLE: "engage>preflight p; task_failed>fault",
    State.PREFLIGHT: "task_failed>fault; mode_lost>latched; stalled>latched; link_lost>latched; abort>latched; "
    "pose_lost>idle; battery_low>idle; preflight_failed>idle; timeout>idle; preflight_passed>taking_off t",
    State.TAKING_OFF: "task_failed>fault xh; mode_lost>latched x; stalled>latched x; link_lost>latched x; "
    "abort>latched xh; "
    "pose_lost>landing xl; battery_low>landing xl; battery_unknown>landing xl; offboard_refused>latched xh; "
    "takeoff_failed>latched xh; "
    "timeout>latched xh; airborne>taking_off so; offboard_confirmed>acquiring",
    State.ACQUIRING: "task_failed>fault xh; mode_lost>latched x; stalled>latched x; link_lost>latched x; "
    "abort>latched xh; "
    "pose_lost>landing xl; battery_low>landing xl; battery_unknown>landing xl; landed>latched xh; timeout>landing xl; "
    "target_reached>arrived xa; pose_stale>holding; bearing_stale>holding; bearing>approaching; "
    "bearing_back>approaching; retarget>acquiring",
    State.APPROACHING: "task_failed>fault xh; mode_lost>latched x; stalled>latched x; link_lost>latched x; "
    "abort>latched xh; "
    "pose_lost>landing xl; battery_low>landing xl; battery_unknown>landing xl; landed>latched xh; timeout>landing xl; "
    "target_reached>arrived xa; pose_stale>holding; bearing_stale>holding; retarget>acquiring",
    State.ARRIVED: "task_failed>fault; mode_lost>latched; link_lost>latched; abort>latched; pose_lost>landing l; "
    "battery_low>landing l; battery_unknown>landing l; landed>idle g; timeout>landing l; stalled>latched",
    State.HOLDING: "task_failed>fault xh; mode_lost>latched x; stalled>latched x; link_lost>latched x; "
    "abort>latched xh; "
    "pose_lost>landing xl; battery_low>landing xl; battery_unknown>landing xl; landed>latched xh; timeout>landing xw; "
    "target_reached>arrived xa; bearing>approaching; bearing_back>approaching; retarget>acquiring",
    State.LANDING: "task_failed>fault; mode_lost>latched; link_lost>latched; abort>latched; timeout>landing l; "
    "landed>idle g; stalled>latched",
    State.LATCHED: "engage>preflight p; task_failed>fault",
    State.FAULT: "",
}
_INITIALS = {
    "p": Action.RUN_PREFLIGHT,
    "t": Action.ARM_AND_TAKE_OFF,
    "s": Action.STREAM_START,
    "o": Action.REQUEST_OFFBOARD,
    "x": Action.STREAM_STOP,
    "h": Action.LEAVE_TO_HOLD,
    "l": Action.LAND,
    "a": Action.LEAVE_AT_TARGET,
    "w": Action.LEAVE_WITHOUT_TARGET,
    "g": Action.LEAVE_ON_THE_GROUND,
}


def _expected(state: State, event: Event) -> tuple[State, tuple[Action, ...]]:
    for entry in filter(None, _EXPECTED[state].split("; ")):
        name, _, rest = entry.partition(">")
        if name == event:
            target, _, initials = rest.partition(" ")
            return State(target), tuple(_INITIALS[initial] for initial in initials)
    return state, ()


@pytest.mark.parametrize("state", State)
def test_step_of_every_pair(state: State) -> None:
    """All events of a state in one test: hundreds of tests take longer to begin and to end than this takes."""
    assert {event: step(state, event) for event in Event} == {event: _expected(state, event) for event in Event}


@pytest.mark.parametrize("state", State)
def test_leaving_the_streaming_states_stops_the_stream(state: State) -> None:
    for event in Event:
        target, actions = step(state, event)
        if state in STREAM_STATES and target not in STREAM_STATES:
            assert actions[0] is Action.STREAM_STOP, event
        if Action.STREAM_START in actions:
            assert state in STREAM_STATES and target in STREAM_STATES, event


def test_only_a_person_leads_out_of_rest() -> None:
    """From IDLE and LATCHED no chain of events without ENGAGE reaches a state that commands the vehicle."""
    for start in (State.IDLE, State.LATCHED):
        reached, frontier = {start}, [start]
        while frontier:
            state = frontier.pop()
            for event in set(Event) - {Event.ENGAGE}:
                target, actions = step(state, event)
                assert not actions
                if target not in reached:
                    reached.add(target)
                    frontier.append(target)
        assert reached <= {State.IDLE, State.LATCHED, State.FAULT}


def test_who_takes_the_mode_over_is_never_answered_with_a_command() -> None:
    for state in State:
        target, actions = step(state, Event.MODE_LOST)
        assert set(actions) <= {Action.STREAM_STOP}
        if state in _FLYING:
            assert target is State.LATCHED


def test_nothing_leads_out_of_fault() -> None:
    assert all(step(State.FAULT, event) == (State.FAULT, ()) for event in Event)


def test_the_worst_event_that_means_something_wins() -> None:
    assert worst(State.APPROACHING, [Event.TARGET_REACHED, Event.MODE_LOST, Event.BEARING]) is Event.MODE_LOST
    assert worst(State.APPROACHING, [Event.MODE_LOST, Event.TASK_FAILED]) is Event.TASK_FAILED
    assert worst(State.PREFLIGHT, [Event.ENGAGE, Event.ABORT]) is Event.ABORT
    assert worst(State.TAKING_OFF, [Event.OFFBOARD_CONFIRMED, Event.BEARING_STALE]) is Event.OFFBOARD_CONFIRMED
    assert worst(State.FAULT, list(Event)) is None
    assert worst(State.IDLE, []) is None


def test_worst_of_any_two_events_is_the_more_severe_one() -> None:
    order = list(Event)
    for state in State:
        for a in Event:
            for b in Event:
                listed = sorted((e for e in {a, b} if (state, e) in TABLE), key=order.index)
                assert worst(state, [b, a]) is (listed[0] if listed else None)
