"""What is known of the target, and when it is old."""

from __future__ import annotations

import math

import pytest

from companion.camera.sighting import Tag, TagFrame
from companion.core.inputs import Event
from companion.neighbours.neighbour import Neighbour
from tests.unit.companion.camera.tags import TAG
from tests.unit.companion.flight.known import OTHER, TARGET, Known, iteration


def test_a_bearing_that_may_steer_is_reported_and_the_target_recorded() -> None:
    known = Known()
    known.hear(TARGET)
    known.knowledge.add_iteration(iteration())
    assert known.course.worst([]) is Event.BEARING
    assert known.kept.topics == ["/target"]
    assert known.knowledge.blind_legs == 0
    assert not known.knowledge.is_stale()


def test_legs_without_one_are_counted_whatever_the_reason() -> None:
    known = Known()
    for one in (
        iteration(reliability=None, start_ns=0, end_ns=10),
        iteration(reliability=None, start_ns=5, end_ns=15),
        iteration(reliability=0.1, start_ns=15, end_ns=25),
        iteration(p_local_enu_m=None, start_ns=25, end_ns=35),
    ):
        known.knowledge.add_iteration(one)
    known.knowledge.note_blind_leg()
    assert known.knowledge.blind_legs == 4.5
    assert known.kept.topics == ["/target"]  # the weak one is recorded, and what it says little counts
    assert known.course.worst([]) is None
    known.knowledge.grant_leg()
    assert known.knowledge.blind_legs == 1
    known.knowledge.begin_anew()
    assert known.knowledge.blind_legs == 0


def test_what_steers_tells_where_else_the_target_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the way to it is chosen by what it would tell."""
    known = Known()
    monkeypatch.setattr(Neighbour, "newest_pose", lambda _: (1, (0.0, 0.0, 0.0)))
    known.knowledge.add_iteration(iteration())
    aim = known.knowledge.targets.aim((0.0, 0.0, 0.0))
    assert aim is not None
    assert aim.scatter is not None


def test_a_bearing_of_another_robot_is_kept_and_steers_nothing() -> None:
    known = Known()
    known.hear(OTHER)
    known.knowledge.add_iteration(iteration(OTHER))
    assert known.kept.topics == ["/target"]
    assert known.course.worst([]) is None
    assert known.knowledge.targets.target is None
    assert (known.knowledge.packets, known.knowledge.packet_age_s()) == (0, math.inf)


def test_it_is_stale_when_the_target_is_silent_or_the_worker_hangs() -> None:
    known = Known()
    known.hear(TARGET)
    known.knowledge.add_iteration(iteration())
    known.sar.waited_s = 1.6
    assert known.knowledge.is_stale()
    known.sar.waited_s = 0.0
    known.clock.advance(1.9)
    assert not known.knowledge.is_stale()
    known.clock.advance(0.2)
    assert known.knowledge.is_stale()
    known.hear(TARGET)
    assert known.knowledge.is_stale(), "its datagrams are still missing"


def test_refused_iterations_are_told_of_now_and_then(caplog: pytest.LogCaptureFixture) -> None:
    """A vehicle that stands where it is measured has four a second, for hours."""
    known = Known()
    for number in range(100):
        known.knowledge.add_iteration(iteration(reliability=None, number=number, refusal="no path"))
        known.clock.advance(0.25)
    told = [record.getMessage() for record in caplog.records]
    assert told == [
        "SAR iteration 0 refused: no path",
        "SAR iteration 40 refused: no path, as were 39 before",
        "SAR iteration 80 refused: no path, as were 39 before",
    ]


def test_the_bearing_of_a_mission_is_none_of_the_next() -> None:
    known = Known()
    known.hear(TARGET)
    known.knowledge.add_iteration(iteration())
    assert not known.knowledge.is_stale()
    known.knowledge.begin_anew()
    assert known.knowledge.iteration is None and known.knowledge.is_stale()


def test_a_bearing_of_a_flight_that_was_broken_off_lifts_no_hold() -> None:
    known = Known()
    known.hear(TARGET)
    known.sar.is_measuring = False
    known.knowledge.note_hold()
    known.knowledge.add_iteration(iteration())
    assert known.course.worst([]) is None and known.knowledge.tries == 1


def test_another_target_is_heard_by_its_own_packets_and_owes_nothing_to_the_one_before() -> None:
    known = Known()
    known.hear(TARGET)
    known.knowledge.add_iteration(iteration(reliability=None))
    known.knowledge.add_iteration(iteration(OTHER))
    known.knowledge.note_hold()
    known.clock.advance(1.0)
    known.hear(OTHER)
    assert known.knowledge.packet_age_s(OTHER) == 0.0 and known.knowledge.packet_age_s() == 1.0
    assert math.isinf(known.knowledge.datagram_age_s(OTHER))
    known.knowledge.select(OTHER)
    assert known.knowledge.neighbour.id == OTHER and known.knowledge.named("3").id == OTHER
    assert (known.knowledge.blind_legs, known.knowledge.tries, known.knowledge.packets) == (0.0, 0, 0)
    assert known.knowledge.packet_age_s() == 0.0 and math.isinf(known.knowledge.age_s())
    assert known.knowledge.iteration is not None and known.knowledge.iteration.peer == OTHER
    assert known.knowledge.targets.target is not None
    known.course.worst([])
    known.knowledge.add_iteration(iteration(TARGET))
    assert known.course.worst([]) is None, "a bearing of the robot before steers nothing"
    known.knowledge.add_iteration(iteration(OTHER))
    assert known.course.worst([]) is Event.BEARING
    known.knowledge.note_blind_leg()
    known.knowledge.select(OTHER)
    assert known.knowledge.blind_legs == 1.0, "it is the target already"


class _Camera:
    """It leads."""

    def take(self, frame: TagFrame) -> None: ...

    def place(self, peer: int) -> object:
        return object()


@pytest.mark.parametrize(("tags", "blind"), [((TAG,), 0.0), ((), 1.0)])
def test_an_image_without_a_tag_which_no_log_holds_decides_nothing(tags: tuple[Tag, ...], blind: float) -> None:
    known = Known()
    known.knowledge.camera = _Camera()  # type: ignore[assignment]
    known.knowledge.note_blind_leg()
    known.knowledge.take_tags(TagFrame(t_mono_ns=1, family="tag36h11", tags=tags))
    assert known.knowledge.blind_legs == blind
    assert known.course.worst([]) is (Event.BEARING if tags else None)
