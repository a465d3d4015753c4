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
from companion.flight.course import Course
from companion.flight.engagement import Engagement
from companion.flight.rc_switch import RcSwitch
from companion.mission.table import State

_log = logging.getLogger(__name__)
_RC_S: Final = 1.0
"""RC_CHANNELS come at 5 Hz. After a longer silence how the switch stands is not known."""

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
        switch: RcSwitch | None,
        beside: Beside,
    ) -> None:
        self._clock = clock
        self._recorder = recorder
        self._course = course
        self._engagement = engagement
        self._switch = switch
        self._beside = beside
        self._aborts = 0

    async def engage(self) -> str:
        """To hand over the vehicle. Returns the whole list of what stands against it, or nothing."""
        return self.answer(Event.ENGAGE, await self._refusal())

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

    def answer(self, wish: Event, refusal: str, by_switch: bool = False) -> str:
        """A wish has been answered: granted, if there is no refusal."""
        with self._clock.event() as now_ns:
            self._recorder.record(WISH, now_ns, Wish(now_ns, wish, refusal, by_switch, self._engagement.vehicle))
            if not refusal:
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
        # What was heard last says nothing of how the switch stands now.
        heard = age_s(vehicle.rc_mono_ns, self._clock.now_ns()) <= _RC_S
        wish = self._switch.update(vehicle.rc_us if heard else ())
        if wish is Event.ENGAGE:
            self._beside(self._engage_by_switch(), "engage by switch")
        elif wish is not None:
            self._aborts += 1
            self._course.report(wish)

    async def _engage_by_switch(self) -> None:
        self.answer(Event.ENGAGE, await self._refusal(), by_switch=True)

    async def _refusal(self) -> str:
        if self._course.state not in (State.IDLE, State.LATCHED):
            return f"the mission is {self._course.state} already"
        aborts, missing = self._aborts, self._engagement.not_ready() + await self._engagement.parameter_problems()
        # Reading parameters takes a moment, and an abort means nothing to a mission that is still at rest.
        return "; ".join(missing + (["it was aborted meanwhile"] if self._aborts != aborts else []))
