"""What a person asks of the flight: to take the vehicle, or to let go; by a command, or by a switch of the transmitter.

An answer is recorded, and a wish that was granted counts at the next tick; nothing here commands.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Coroutine
from typing import Any, Final

from companion.core.clock import age_s
from companion.core.event_clock import EventClock
from companion.core.inputs import Event, Wish
from companion.core.messages import VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import WISH
from companion.errors import CompanionError
from companion.flight.course import Course
from companion.flight.engagement import Engagement
from companion.flight.knowledge import Knowledge
from companion.flight.rc_switch import RcSwitch
from companion.mission.table import State
from companion.neighbours.neighbour import Neighbour

_log = logging.getLogger(__name__)
_RC_S: Final = 1.0
"""RC_CHANNELS come at 5 Hz. After a longer silence how the switch stands is not known."""

_CHANGEABLE: Final = frozenset({State.TAKING_OFF, State.ACQUIRING, State.APPROACHING, State.HOLDING})
"""States in which the vehicle is on its way to a robot, and may be sent to another one."""

Beside = Callable[[Coroutine[Any, Any, None], str], None]


class Wishes:
    """`beside` runs something that asks beside the loop, under a name."""

    def __init__(
        self,
        *,
        clock: EventClock,
        recorder: Recorder,
        course: Course,
        engagement: Engagement,
        knowledge: Knowledge,
        switch: RcSwitch | None,
        beside: Beside,
    ) -> None:
        self._clock = clock
        self._recorder = recorder
        self._course = course
        self._engagement = engagement
        self._knowledge = knowledge
        self._switch = switch
        self._beside = beside
        self._aborts = 0
        self._watched_ns: int | None = None

    async def engage(self, target: str | None = None) -> str:
        """To hand over the vehicle, to fly to the robot of that name or id; without one to the robot that is the target
        already. In flight it may be sent to another one. Returns the whole list of what stands against it, or nothing.
        """
        if target is None:
            return self.answer(Event.ENGAGE, await self._refusal(None))
        try:
            robot = self._knowledge.named(target)
        except CompanionError as error:
            return self.answer(Event.ENGAGE, str(error))
        if self._course.state in _CHANGEABLE:
            return self.answer(Event.RETARGET, self._kept(robot), target=robot.id)
        return self.answer(Event.ENGAGE, await self._refusal(robot), target=robot.id)

    @property
    def target(self) -> str:
        """Name of the robot that is flown to."""
        return self._knowledge.neighbour.name

    @property
    def vehicle(self) -> str:
        """Which one the wishes are about."""
        return self._engagement.vehicle

    def abort(self) -> None:
        """To end the flight."""
        self._aborts += 1
        self.answer(Event.ABORT, "")

    def outdate(self) -> None:
        """What is being asked for now, or was granted and not taken up yet, is not wanted any more: the world has moved
        on since a person did."""
        self._aborts += 1
        self._course.withdraw()

    def answer(self, wish: Event, refusal: str, by_switch: bool = False, target: int | None = None) -> str:
        """A wish has been answered: granted, if there is no refusal; then `target`, if there is one, is flown to."""
        with self._clock.event() as now_ns:
            told = Wish(
                t_mono_ns=now_ns,
                wish=wish,
                refusal=refusal,
                by_switch=by_switch,
                vehicle=self._engagement.vehicle,
                target=target,
            )
            self._recorder.record(WISH, now_ns, told)
            if not refusal:
                if target is not None:
                    self._knowledge.select(target)
                _log.info("%s: %s", wish, self._engagement.vehicle)
                self._course.report(wish)
            elif by_switch:
                self._course.explain(f"the switch did not engage: {refusal}")
                _log.warning(self._course.reason)
        return refusal

    def watch_switch(self, vehicle: VehicleState) -> None:
        """Each tick: what the transmitter's switch asks for, if there is one."""
        if self._switch is None:
            return
        now_ns = self._clock.now_ns()
        watched_s, self._watched_ns = age_s(self._watched_ns, now_ns), now_ns
        if watched_s > _RC_S:
            self._switch.update(())  # we stood still: how the switch was moved meanwhile was for nobody
        # What was heard last says nothing of how the switch stands now.
        heard = age_s(vehicle.rc_mono_ns, now_ns) <= _RC_S
        wish = self._switch.update(vehicle.rc_us if heard else ())
        if wish is Event.ENGAGE:
            self._beside(self._engage_by_switch(), "engage by switch")
        elif wish is not None:
            self._aborts += 1
            self._course.report(wish)

    async def _engage_by_switch(self) -> None:
        self.answer(Event.ENGAGE, await self._refusal(None), by_switch=True)

    def _kept(self, robot: Neighbour) -> str:
        """Why the vehicle keeps to the target it has."""
        if robot.id == self._knowledge.neighbour.id:
            return f"the mission is {self._course.state} already, to {robot.name}"
        return "; ".join(f"{robot.name}: {problem}" for problem in self._engagement.not_heard(robot))

    async def _refusal(self, robot: Neighbour | None) -> str:
        if under_way := self._under_way():
            return under_way
        aborts = self._aborts
        missing = self._engagement.not_ready(robot) + await self._engagement.parameter_problems()
        # Reading parameters takes a moment. Whoever else engaged meanwhile flies to the robot that he named; and an
        # abort means nothing to a mission that is still at rest.
        if under_way := self._under_way():
            return under_way
        return "; ".join(missing + (["it was aborted meanwhile"] if self._aborts != aborts else []))

    def _under_way(self) -> str:
        """Why nobody can engage now; empty while the mission is at rest."""
        state = self._course.state
        return "" if state in (State.IDLE, State.LATCHED) else f"the mission is {state} already"
