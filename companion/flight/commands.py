"""Commands to the autopilot that run beside the 20 Hz loop, one at a time: a newer one replaces an older one."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from companion.autopilot.port import Autopilot, AutopilotError, GaveWayError
from companion.core.clock import NS_PER_S, Clock
from companion.core.inputs import Event
from companion.core.messages import FlightMode

_log = logging.getLogger(__name__)
WARM_UP_S = 1.0  # PX4 wants a running stream before it lets anybody into OFFBOARD
_LEAVE_S = 0.5
_POSITION_S = 0.5
_DISARMS_S = 15.0
_LOOK_S = 0.1
_OURS = frozenset({FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD})
"""Modes in which the vehicle is while this flies it: the others are somebody's decision."""

Command = Coroutine[Any, Any, None]
Report = Callable[[Event | None, str], None]


class FlightCommands:
    """`report` gets the event that a command ended in, and the reason when it failed."""

    def __init__(self, autopilot: Autopilot, clock: Clock, report: Report) -> None:
        self._autopilot = autopilot
        self._clock = clock
        self._report = report
        self._tasks = asyncio.TaskGroup()
        self._running: asyncio.Task[None] | None = None

    async def __aenter__(self) -> FlightCommands:
        await self._tasks.__aenter__()
        return self

    async def __aexit__(self, *failure: Any) -> None:
        await self._tasks.__aexit__(*failure)

    def start(self, command: Command, done: Event | None = None, failed: Event | None = None) -> None:
        self.cancel()
        self._running = self._tasks.create_task(self._run(command, done, failed), name="command")

    def beside(self, command: Command, name: str) -> None:
        """Runs something that asks and commands nothing; it replaces no command."""
        self._tasks.create_task(command, name=name)

    def cancel(self) -> None:
        if self._running is not None:
            self._running.cancel()
            self._running = None

    async def take_off(self, height_m: float) -> None:
        if not self._autopilot.state().in_air:
            await self._autopilot.arm()
        await self._autopilot.takeoff(height_m)

    async def arm(self) -> None:
        """All that a vehicle needs that does not fly."""
        if not self._autopilot.state().armed:
            await self._autopilot.arm()

    async def enter_offboard(self) -> None:
        await self._clock.sleep_until_ns(self._clock.now_ns() + round(WARM_UP_S * NS_PER_S))
        await self._autopilot.request_offboard()

    async def hold(self) -> None:
        await self._or_land(self._autopilot.hold())

    async def land(self) -> None:
        await self._autopilot.land()

    async def return_home(self, look: Callable[[], Awaitable[list[str]]]) -> None:
        """`look` says what is wrong with the way home now; with anything, or without an answer, it lands."""
        try:
            async with asyncio.timeout(_LEAVE_S):
                problems = await look()
        except TimeoutError:
            problems = ["the parameters of a return were not read"]
        if problems:
            _log.error("%s; landing instead of returning", "; ".join(problems))
            await self._autopilot.land()
        else:
            await self._or_land(self._autopilot.return_home())

    async def leave_on_the_ground(self) -> None:
        """After our landing: PX4 goes back to OFFBOARD when it disarms, if hold could not be had on the way down. There
        it neither arms nor says why, so it is taken out; whoever chose another mode keeps it."""
        deadline_ns = self._clock.now_ns() + round(_DISARMS_S * NS_PER_S)
        while self._autopilot.state().armed and self._clock.now_ns() < deadline_ns:
            await self._clock.sleep_until_ns(self._clock.now_ns() + round(_LOOK_S * NS_PER_S))
        await self._clock.sleep_until_ns(self._clock.now_ns() + round(_LEAVE_S * NS_PER_S))
        state = self._autopilot.state()
        if FlightMode.OFFBOARD in (state.mode, state.intended_mode) and not state.armed:
            await self._autopilot.hold()

    async def leave_at_end(self) -> None:
        """The service ends in flight: the autopilot's hold, or a landing where it has no position, within half a
        second. What is not confirmed by then is left to the autopilot's own loss-of-stream failsafe. Whoever has taken
        the mode meanwhile, since the last tick, keeps it."""
        self.cancel()
        state = self._autopilot.state()
        if state.mode not in _OURS:
            _log.warning("not leaving: the mode is %s already; somebody else decided", state.mode)
            return
        age_ns = state.t_mono_ns - (state.position_mono_ns or 0)
        has_position = state.position_mono_ns is not None and age_ns < _POSITION_S * NS_PER_S
        try:
            async with asyncio.timeout(_LEAVE_S):
                await (self.hold() if has_position else self._autopilot.land())
        except (AutopilotError, TimeoutError):
            _log.error("leaving was commanded but not confirmed; the autopilot's loss-of-stream failsafe takes over")

    async def _or_land(self, command: Command) -> None:
        try:
            await command
        except GaveWayError:
            raise
        except AutopilotError as error:
            _log.error("%s; landing instead", error)  # hold and return need a position, landing does not
            await self._autopilot.land()

    async def _run(self, command: Command, done: Event | None, failed: Event | None) -> None:
        try:
            await command
        except AutopilotError as error:
            _log.error("%s", error)
            self._report(failed, str(error))
            return
        self._report(done, "")


MakeCommands = Callable[[Autopilot, Clock, Report], FlightCommands]
