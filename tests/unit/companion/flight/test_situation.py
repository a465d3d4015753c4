"""What only the flight knows of the situation: whether the vehicle took off, and how old the stream is."""

from __future__ import annotations

from dataclasses import replace

from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.inputs import Event
from companion.core.messages import FlightMode, Vector3, VehicleState
from companion.flight.course import Course
from companion.flight.situation import Situations
from companion.mission.conditions import Situation
from tests.kept import Kept
from tests.manual_clock import ManualClock

_STANDS = VehicleState(t_mono_ns=0, mode=FlightMode.HOLD)


class _Others:
    """Poses, and what is known of the target."""

    blind_legs, tries = 1.5, 2

    @property
    def targets(self) -> _Others:
        return self

    def age_s(self) -> float:
        return 0.25

    def is_lost(self) -> bool:
        return False

    def is_near(self, p_m: Vector3) -> bool:
        return p_m[0] > 0


class _Ticking:
    """A flight whose ticks are 50 ms apart."""

    def __init__(self) -> None:
        others = _Others()
        self.now_ns = 10 * NS_PER_S
        self.course = Course(EventClock(ManualClock(self.now_ns)), Kept())
        self.situations = Situations(self.course, others, others)  # type: ignore[arg-type]

    def tick(self, vehicle: VehicleState, *steps: Event, streaming: bool = False, sent: bool = False) -> Situation:
        self.now_ns += NS_PER_S // 20
        self.situations.see(vehicle)
        seen = self.situations.now(vehicle, self.now_ns, 0.0)
        for event in steps:
            self.course.step(event, self.now_ns)
        if sent:
            self.situations.note_sent(self.now_ns)
        self.situations.end_tick(self.now_ns, streaming)
        return seen


def test_others_are_asked() -> None:
    seen = _Ticking().tick(replace(_STANDS, p_local_enu_m=(1.0, 0.0, 0.0)))
    assert (seen.pose_age_s, seen.target_age_s, seen.blind_legs, seen.tries) == (0.25, 0.25, 1.5, 2)
    assert seen.target_near and not seen.pose_failed and seen.in_state_s == 0.05
    assert not _Ticking().tick(_STANDS).target_near, "nothing is near to a vehicle without a position"


def test_it_took_off_when_it_was_seen_to_while_it_was_told_to() -> None:
    ticking = _Ticking()
    assert not ticking.tick(replace(_STANDS, mode=FlightMode.TAKEOFF), Event.ENGAGE, Event.PREFLIGHT_PASSED).took_off
    assert not ticking.tick(_STANDS).took_off and not ticking.situations.is_taking_off
    assert ticking.tick(replace(_STANDS, mode=FlightMode.TAKEOFF)).took_off
    assert ticking.tick(_STANDS).took_off, "what was seen stays"
    assert ticking.situations.is_taking_off
    ticking.situations.begin_anew(_STANDS)
    assert not ticking.tick(_STANDS).took_off
    ticking.situations.begin_anew(replace(_STANDS, in_air=True))
    assert ticking.tick(_STANDS).took_off, "one that is engaged in the air has"


def test_the_stream_grows_old_from_its_newest_set_point_or_from_its_beginning() -> None:
    ticking = _Ticking()
    assert ticking.tick(_STANDS, streaming=True).stream_gap_s == 0.0
    assert ticking.tick(_STANDS, streaming=True).stream_gap_s == 0.05
    assert ticking.tick(_STANDS, streaming=True, sent=True).stream_gap_s == 0.1
    assert ticking.tick(_STANDS).stream_gap_s == 0.05
    assert ticking.tick(_STANDS).stream_gap_s == 0.0, "the stream has ended"


def test_in_preflight_the_look_of_the_last_tick_grows_old() -> None:
    ticking = _Ticking()
    assert ticking.tick(_STANDS, Event.ENGAGE).stream_gap_s == 0.0
    assert ticking.tick(_STANDS).stream_gap_s == 0.05
    assert ticking.tick(_STANDS).stream_gap_s == 0.05


def test_a_clock_of_ours_that_stood_still_counts_from_the_engagement() -> None:
    ticking = _Ticking()
    ticking.situations.begin_anew(replace(_STANDS, stood_still_ns=3 * NS_PER_S))
    assert ticking.tick(replace(_STANDS, stood_still_ns=4 * NS_PER_S)).stood_still_s == 1.0


def test_restarts_and_lost_modes_count_from_the_engagement() -> None:
    flight = _Ticking()
    before = replace(_STANDS, boots=2, offboard_left=3)
    flight.situations.begin_anew(before)
    for vehicle, restarted, left in (
        (before, False, False),
        (replace(before, boots=3), True, False),
        (replace(before, offboard_left=4), False, True),
    ):
        seen = flight.tick(vehicle)
        assert (seen.restarted, seen.left_offboard) == (restarted, left)
