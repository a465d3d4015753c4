"""Where the mission stands: what is reported waits for the tick, and which of it survives one."""

from __future__ import annotations

import pytest

from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.inputs import Event
from companion.core.streams import MISSION
from companion.flight.course import Course
from companion.flight.records import SERVICE_ENDS, MissionStep
from companion.mission.table import Action, State
from tests.kept import Kept
from tests.manual_clock import ManualClock


@pytest.fixture
def kept() -> Kept:
    return Kept()


@pytest.fixture
def course(kept: Kept) -> Course:
    return Course(EventClock(ManualClock(NS_PER_S)), kept)


def _taking_off(course: Course) -> None:
    course.step(Event.ENGAGE, 2 * NS_PER_S)
    course.step(Event.PREFLIGHT_PASSED, 3 * NS_PER_S)
    assert course.state is State.TAKING_OFF


def test_a_step_is_recorded_with_what_it_asks_for(course: Course, kept: Kept) -> None:
    assert course.step(Event.ENGAGE, 2 * NS_PER_S) == (Action.RUN_PREFLIGHT,)
    assert (course.state, course.since_ns, course.reason) == (State.PREFLIGHT, 2 * NS_PER_S, "engage")
    step = MissionStep(
        t_mono_ns=2 * NS_PER_S,
        state=State.IDLE,
        event=Event.ENGAGE,
        next_state=State.PREFLIGHT,
        actions=(Action.RUN_PREFLIGHT,),
        reason="engage",
    )
    assert kept.messages == [(MISSION, 2 * NS_PER_S, step)]


def test_of_several_reports_the_worst_counts_and_the_others_wait(course: Course) -> None:
    _taking_off(course)
    course.report(Event.AIRBORNE)
    course.report(Event.ABORT)
    assert course.worst([Event.POSE_LOST]) is Event.ABORT
    assert course.worst([]) is Event.AIRBORNE
    assert course.worst([]) is None


def test_a_wish_to_engage_that_lost_must_be_made_again(course: Course) -> None:
    course.report(Event.ENGAGE)
    assert course.worst([Event.TASK_FAILED]) is Event.TASK_FAILED
    assert course.worst([]) is None


def test_an_abort_takes_back_a_wish_that_was_granted_and_not_taken_up(course: Course) -> None:
    course.report(Event.ENGAGE)
    course.report(Event.ABORT)
    assert course.worst([]) is None
    course.report(Event.ABORT)
    course.report(Event.ENGAGE)
    assert course.worst([]) is Event.ENGAGE


def test_a_report_without_a_meaning_in_this_state_is_dropped(course: Course) -> None:
    course.report(Event.BEARING)
    assert course.worst([]) is None
    _taking_off(course)
    course.step(Event.AIRBORNE, 4 * NS_PER_S)
    course.step(Event.OFFBOARD_CONFIRMED, 5 * NS_PER_S)
    assert course.worst([]) is None


def test_what_was_reported_of_a_flight_that_has_ended_is_forgotten(course: Course) -> None:
    _taking_off(course)
    course.report(Event.AIRBORNE)
    course.step(Event.ABORT, 4 * NS_PER_S)
    assert course.state is State.LATCHED
    course.step(Event.ENGAGE, 5 * NS_PER_S)
    course.step(Event.PREFLIGHT_PASSED, 6 * NS_PER_S)
    assert course.worst([]) is None


def test_a_failure_says_why(course: Course) -> None:
    _taking_off(course)
    course.report(Event.TAKEOFF_FAILED, "no propellers")
    assert course.worst([]) is Event.TAKEOFF_FAILED
    course.step(Event.TAKEOFF_FAILED, 4 * NS_PER_S)
    assert course.reason == "takeoff_failed: no propellers"


def test_the_end_of_the_service_is_the_last_step(course: Course, kept: Kept) -> None:
    course.end(9 * NS_PER_S)
    assert course.state is State.FAULT
    assert kept.messages[-1][2] == MissionStep(
        t_mono_ns=9 * NS_PER_S,
        state=State.IDLE,
        event=Event.TASK_FAILED,
        next_state=State.FAULT,
        actions=(),
        reason=SERVICE_ENDS,
    )
