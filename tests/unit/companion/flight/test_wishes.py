"""What a person asks: the answer is recorded, and only a granted wish reaches the mission."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.inputs import Event, Wish
from companion.core.messages import VehicleState
from companion.flight.course import Course
from companion.flight.rc_switch import RcSwitch
from companion.flight.wishes import Wishes
from companion.mission.table import State
from companion.neighbours.naming import named
from companion.neighbours.neighbour import Neighbour
from tests.kept import Kept
from tests.manual_clock import ManualClock

_NOW_NS = 100 * NS_PER_S


class _Engagement:
    """Misses what a test says; reading parameters takes until it is let go."""

    vehicle = "system 1, px4 1.16.1"

    def __init__(self) -> None:
        self.missing: list[str] = []
        self.read = asyncio.Event()
        self.read.set()

    def not_ready(self, target: Neighbour | None = None) -> list[str]:
        return list(self.missing)

    def not_heard(self, target: Neighbour) -> list[str]:
        return [] if target.heard_ns else ["no datagrams of the target"]

    async def parameter_problems(self) -> list[str]:
        await self.read.wait()
        return []


class _Knowledge:
    """Of two robots, of which the first is the target."""

    def __init__(self) -> None:
        self.robots = (Neighbour(2, "alpha"), Neighbour(3, "beta"))
        self.neighbour = self.robots[0]

    def named(self, word: str) -> Neighbour:
        return named(word, self.robots)

    def select(self, peer: int) -> None:
        self.neighbour = next(robot for robot in self.robots if robot.id == peer)


class _Asked:
    """The wishes of a mission, with what they are made of."""

    def __init__(self) -> None:
        self.clock, self.kept, self.engagement = ManualClock(_NOW_NS), Kept(), _Engagement()
        clock = EventClock(self.clock)
        self.course = Course(clock, self.kept)
        self.knowledge = _Knowledge()
        self.beside: list[Coroutine[Any, Any, None]] = []
        self.wishes = Wishes(
            clock=clock, recorder=self.kept, course=self.course, engagement=self.engagement, switch=RcSwitch(1, 1700),  # type: ignore[arg-type]
            knowledge=self.knowledge,  # type: ignore[arg-type]
            beside=lambda work, name: self.beside.append(work),
        )  # fmt: skip

    def switch(self, us: int, age_s: float = 0.0) -> None:
        now_ns = self.clock.now_ns()
        self.wishes.watch_switch(
            VehicleState(t_mono_ns=now_ns, rc_mono_ns=now_ns - round(age_s * NS_PER_S), rc_us=(us,))
        )


async def test_an_engagement_that_is_granted_counts_at_the_next_tick() -> None:
    asked = _Asked()
    assert await asked.wishes.engage() == ""
    assert [message for _, _, message in asked.kept.messages] == [
        Wish(t_mono_ns=_NOW_NS, wish=Event.ENGAGE, refusal="", vehicle="system 1, px4 1.16.1")
    ]
    assert asked.course.worst([]) is Event.ENGAGE


async def test_all_that_stands_against_it_is_told_and_nothing_happens() -> None:
    asked = _Asked()
    asked.engagement.missing = ["no poses", "no packets"]
    assert await asked.wishes.engage() == "no poses; no packets"
    assert asked.course.worst([]) is None
    asked.course.step(Event.ENGAGE, _NOW_NS)
    assert await asked.wishes.engage() == "the mission is preflight already"


async def test_an_abort_while_parameters_are_read_stands_against_it() -> None:
    asked = _Asked()
    asked.engagement.read.clear()
    engaging = asyncio.create_task(asked.wishes.engage())
    await asyncio.sleep(0)
    asked.wishes.abort()
    asked.engagement.read.set()
    assert await engaging == "it was aborted meanwhile"


async def test_who_is_overtaken_while_parameters_are_read_engages_nobody_and_turns_the_flight_to_no_other_robot() -> (
    None
):
    asked = _Asked()
    asked.engagement.read.clear()
    engaging = asyncio.create_task(asked.wishes.engage("beta"))
    await asyncio.sleep(0)
    for event in (Event.ENGAGE, Event.PREFLIGHT_PASSED):  # by the switch, to alpha
        asked.course.step(event, _NOW_NS)
    asked.engagement.read.set()
    assert await engaging == "the mission is taking_off already"
    assert asked.wishes.target == "alpha" and asked.course.worst([]) is None


async def test_what_was_granted_before_the_host_slept_is_not_wanted_any_more() -> None:
    asked = _Asked()
    assert await asked.wishes.engage() == ""
    asked.wishes.outdate()
    assert asked.course.worst([]) is None


async def test_the_switch_engages_beside_the_loop_and_says_why_not() -> None:
    asked = _Asked()
    asked.engagement.missing = ["no poses"]
    asked.switch(1100)
    asked.switch(1900)
    (work,) = asked.beside
    await work
    assert asked.kept.messages[-1][2] == Wish(
        t_mono_ns=_NOW_NS, wish=Event.ENGAGE, refusal="no poses", by_switch=True, vehicle="system 1, px4 1.16.1"
    )
    assert asked.course.reason == "the switch did not engage: no poses"


def test_the_switch_aborts_at_once_and_old_pulse_widths_say_nothing() -> None:
    asked = _Asked()
    asked.switch(1900)
    asked.switch(1100, age_s=1.5)
    asked.course.step(Event.ENGAGE, _NOW_NS)
    assert asked.course.worst([]) is None
    asked.switch(1900)
    asked.switch(1100)
    assert asked.course.worst([]) is Event.ABORT
    assert asked.beside == []


def test_a_switch_that_was_moved_while_we_stood_still_engages_nobody() -> None:
    """What lay in the line comes at once when the program goes on, and looks new."""
    asked = _Asked()
    asked.switch(1100)
    asked.clock.advance(2.0)
    asked.switch(1900)
    assert asked.beside == []
    asked.switch(1100)
    asked.switch(1900)
    assert len(asked.beside) == 1
    asked.beside[0].close()


async def test_a_robot_that_is_named_becomes_the_target_only_where_the_wish_is_granted() -> None:
    asked = _Asked()
    asked.engagement.missing = ["no poses"]
    assert await asked.wishes.engage("beta") == "no poses"
    assert asked.wishes.target == "alpha"
    asked.engagement.missing = []
    assert await asked.wishes.engage("3") == ""
    assert asked.wishes.target == "beta"
    assert [(wish.wish, wish.refusal, wish.target) for _, _, wish in asked.kept.messages] == [
        (Event.ENGAGE, "no poses", 3),
        (Event.ENGAGE, "", 3),
    ]
    assert asked.course.worst([]) is Event.ENGAGE


async def test_a_name_that_nobody_has_is_refused_with_those_there_are() -> None:
    asked = _Asked()
    refusal = await asked.wishes.engage("gamma")
    assert refusal == "no robot has the name or id 'gamma'; expected one of alpha (2), beta (3)"
    assert asked.course.worst([]) is None and asked.wishes.target == "alpha"
    assert [wish.refusal for _, _, wish in asked.kept.messages] == [refusal]


def _fly(asked: _Asked) -> None:
    for event in (Event.ENGAGE, Event.PREFLIGHT_PASSED, Event.AIRBORNE, Event.OFFBOARD_CONFIRMED, Event.BEARING):
        asked.course.step(event, _NOW_NS)


async def test_in_flight_the_vehicle_is_sent_to_another_robot_that_is_heard_and_to_no_other() -> None:
    asked = _Asked()
    _fly(asked)
    assert await asked.wishes.engage() == "the mission is approaching already"
    assert await asked.wishes.engage("alpha") == "the mission is approaching already, to alpha"
    assert await asked.wishes.engage("beta") == "beta: no datagrams of the target"
    assert asked.wishes.target == "alpha" and asked.course.worst([]) is None
    asked.knowledge.robots[1].heard_ns = _NOW_NS
    assert await asked.wishes.engage("beta") == ""
    assert asked.wishes.target == "beta"
    assert asked.course.worst([]) is Event.RETARGET
    asked.course.step(Event.RETARGET, _NOW_NS)
    assert asked.course.state is State.ACQUIRING


async def test_another_robot_undoes_neither_an_abort_nor_the_latch() -> None:
    asked = _Asked()
    _fly(asked)
    asked.knowledge.robots[1].heard_ns = _NOW_NS
    assert await asked.wishes.engage("beta") == ""
    asked.wishes.abort()
    worst = asked.course.worst([])
    assert worst is Event.ABORT
    asked.course.step(worst, _NOW_NS)
    assert asked.course.state is State.LATCHED and asked.course.worst([]) is None
    asked.wishes.answer(Event.RETARGET, "", target=2)
    assert asked.course.worst([]) is None and asked.course.state is State.LATCHED
