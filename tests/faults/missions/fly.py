"""Flies one scenario and keeps its trace."""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections.abc import Sequence
from typing import Any, Final, cast
from unittest import mock

from companion.autopilot import mavsdk_edge, onboard_status
from companion.autopilot.snapshot import SnapshotAutopilot
from companion.core.clock import NS_PER_S, HostSleep
from companion.core.event_clock import EventClock
from companion.core.inputs import Surroundings
from companion.core.messages import Pose, VehicleState
from companion.core.streams import MISSION, TICK, VEHICLE, WISH, Stream
from companion.flight.loop import Flight
from companion.mission.table import State
from companion.pose.intake import PoseIntake
from companion.sensing.iterations import SarIterations
from companion.sensing.lookalikes import Lookalikes
from companion.sim.px4.commander import Mode
from companion.study.virtual_parts import BEACON_ID
from tests.faults.missions.port import Started
from tests.faults.missions.reality import Reality, RealSenses
from tests.faults.missions.scenario import MOST_S, Fault, Scenario
from tests.faults.missions.target import DrawnSenses, NoPoses
from tests.faults.missions.timeless import MissionClock, MissionLoop
from tests.faults.missions.trace import (
    LINK_FAULTS,
    Asked,
    Failed,
    Faulted,
    Moded,
    Sent,
    Served,
    Switched,
    Ticked,
    Trace,
)
from tests.faults.missions.tracker import FaultyTracker
from tests.faults.missions.vehicle import Vehicle, VehicleLink, edge_on, setpoint

_BATTERIES: dict[str, dict[int, float | None]] = {
    "low": {0: 0.1}, "second low": {0: 0.9, 1: 0.05}, "unknown": {0: None}, "second unknown": {0: 0.9, 1: None},
    "silent": {},
}  # fmt: skip
_POLL_S: Final = 0.05
"""How often the edge looks whether what it asked for has come, instead of each 10 ms."""
_AT_REST = frozenset({State.IDLE, State.LATCHED, State.FAULT})
_ASKS_AFTER_S = (1.0, 2.0, 4.0)
_CHECKS_S = 3.0
"""How old a word that PX4's arming checks pass may be."""
_QUIET_S = 4.0
"""A mission is flown on for so long after the last that was to happen."""


def fly(scenario: Scenario, is_real: bool = False) -> Trace:
    """The same scenario gives the same trace. `is_real`: radio, cameras and estimator are computed, not drawn."""
    logging.getLogger("companion").setLevel(logging.CRITICAL + 1)
    clock = MissionClock(0) if is_real else MissionClock()
    loop = MissionLoop(clock)
    seldom = mock.patch.object(mavsdk_edge, "_POLL_S", _POLL_S)
    unread = mock.patch.object(onboard_status, "fields", dict)
    try:
        with seldom, unread:
            world = World(scenario, clock, loop, Reality(scenario) if is_real else None)
            loop.connect(world.advance)
            loop.run_until_complete(world.run())
        return world.trace
    finally:
        loop.close()
        logging.getLogger("companion").setLevel(logging.NOTSET)


class Service:
    """One start of the companion: the parts that `companion.roles` would build, as they are."""

    def __init__(self, world: World) -> None:
        scenario, clock = world.scenario, world.clock
        self.world = world
        self.failed = False
        self.told: VehicleState | None = None
        """At this tick."""
        self._ticks = False
        self.senses = senses = DrawnSenses(world) if world.reality is None else RealSenses(world)
        self.link = VehicleLink(world.vehicle, self.note_sent)
        self.edge = edge_on(world.vehicle, self.link)
        self.intake = PoseIntake(scenario.config.pose, clock, NoPoses(), senses.on_pose)
        event_clock = EventClock(clock)
        self.sar = SarIterations(
            window=cast(Any, senses.window), worker=senses.worker, neighbours=senses.neighbours,
            config=scenario.config.aperture, clock=event_clock, recorder=self,
            lookalikes=Lookalikes({BEACON_ID: "beacon"}),
            pose_problem=self.intake.problem_between,
        )  # fmt: skip
        self.flight = Flight(
            config=scenario.config, clock=event_clock, intake=self.intake, neighbours=senses.neighbours,
            autopilot=SnapshotAutopilot(self.edge, event_clock, self), sar=self.sar, recorder=self, look=self.look,
        )  # fmt: skip
        self.flight._sleep = HostSleep(clock.now_ns, clock.boot_ns)
        self.sar.iterations.connect(self.flight.knowledge.add_iteration)
        self.tasks = [world.loop.create_task(self._run(part)) for part in (self.edge.run, self.flight.run)]
        world.trace.entries.append(Served(clock.t_ns, "begins"))

    async def _run(self, part: Any) -> None:
        try:
            await part()
        except asyncio.CancelledError:
            raise
        except Exception as error:  # noqa: BLE001 - whatever the flight raises is what is looked for
            self.world.trace.entries.append(Failed(self.world.clock.t_ns, repr(error)))

    def look(self) -> Surroundings:
        engagement = self.flight._engagement
        checked_s = engagement._age_s(engagement._checked_ns)
        return Surroundings(
            t_mono_ns=self.world.clock.t_ns, autopilot_problem=self.edge.problem, parameters_checked=checked_s < 30.0,
            bad_signatures=0, recorder_failed=self.failed, free_mib=5000.0,
        )  # fmt: skip

    def counters(self) -> dict[str, int]:
        return {}

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        if stream is TICK:
            self._ticks = True
        elif stream is VEHICLE and self._ticks:  # the tick's own look
            self._ticks, self.told = False, message
            self.world.note_tick(self, message)
        elif stream in (MISSION, WISH):
            self.world.trace.entries.append(message)

    def note_sent(self, name: str, fields: dict[str, Any]) -> None:
        """Everything that leaves, as it leaves."""
        now_ns, entries = self.world.clock.t_ns, self.world.trace.entries
        if name == "SET_POSITION_TARGET_LOCAL_NED":
            places, really = self.flight.knowledge.targets.places(), self.world.vehicle.commander.mode
            told = self.told if self.told is not None and self.told.t_mono_ns == now_ns else self.edge.state()
            offered, state = setpoint(fields, now_ns), self.flight.state
            entries.append(
                Sent(
                    t_ns=now_ns, setpoint=offered, told=told, state=state, really=really, places=places,
                    ground_m=self.flight._frame.ground_m,
                )
            )  # fmt: skip
        elif name == "COMMAND_LONG" and fields["command"] in (22, 176, 400):
            wanted = None
            if fields["command"] == 176:
                wanted = next(m for m in Mode if m.value == (fields["param2"], fields["param3"]))
            what = {22: "takeoff", 176: "mode", 400: "arm" if fields["param1"] else "disarm"}[fields["command"]]
            entries.append(
                Asked(t_ns=now_ns, what=what, wanted=wanted, told=self.edge.state(), state=self.flight.state)
            )


class World:
    """Everything around the service: moves on whenever all of its tasks sleep."""

    def __init__(
        self, scenario: Scenario, clock: MissionClock, loop: MissionLoop, reality: Reality | None = None
    ) -> None:
        self.scenario, self.clock, self.loop, self.reality = scenario, clock, loop, reality
        self.rng = random.Random(f"world {scenario.seed}")
        self.trace = Trace(scenario)
        self.vehicle = Vehicle(scenario, clock)
        self._modes_seen = len(self.vehicle.commander.history)
        self._start_ns = clock.t_ns
        self._step_ns = clock.t_ns + self.rng.randrange(scenario.step_ns)
        self._faults = list(scenario.faults)
        self._lasting: list[tuple[int, Fault]] = []
        self._words: dict[str, str] = {}
        """By kind, of the first that lasts."""
        self._engaged_ns = 0
        self._asks_left = scenario.asks_again
        self._asks_after_s = self.rng.choice(_ASKS_AFTER_S)
        self._tracker = FaultyTracker()
        self._pose_ns = self._packet_ns = self._datagram_ns = clock.t_ns
        self._asking: list[asyncio.Task[Any]] = []
        self._ending: asyncio.Task[None] | None = None
        last_s = max(fault.at_s + min(fault.for_s, 6.0) for fault in scenario.faults) + _QUIET_S
        self._end_ns = self._start_ns + round(min(MOST_S, last_s) * NS_PER_S)
        self.service: Service | None = None
        self._applied_to: Service | None = None
        self._switch_up = False
        self._flew_ns = clock.t_ns

    async def run(self) -> None:
        self.service = Service(self)
        while self.clock.t_ns < self._end_ns and not self._is_over():
            await asyncio.sleep(0.5)
            self._ask_again()
        await self._end("stop")
        if self._ending is not None:
            self._ending.cancel()  # nobody starts it again
            self._asking.append(self._ending)
        await asyncio.gather(*self._asking, return_exceptions=True)

    def _is_over(self) -> bool:
        """Nobody engages any more, and for a while the vehicle has been on the ground or in other hands."""
        at_rest = self.service is not None and self.service.flight.state in _AT_REST
        if not at_rest or not all(asking.done() for asking in self._asking):
            return False
        if self._asks_left or any(fault.kind in ("engage", "switch") for fault in self._faults):
            return False
        return self.clock.t_ns - self._flew_ns > _QUIET_S * NS_PER_S

    def _ask_again(self) -> None:
        now_ns, service = self.clock.t_ns, self.service
        if service is None or self._asks_left == 0 or not all(asking.done() for asking in self._asking):
            return
        rests = service.flight.state in _AT_REST and now_ns - self._flew_ns > self._asks_after_s * NS_PER_S
        if self._engaged_ns and rests:
            self._asks_left -= 1
            self._end_ns = min(self._start_ns + round(MOST_S * NS_PER_S), now_ns + round(10.0 * NS_PER_S))
            self._engage(service)

    def _engage(self, service: Service) -> None:
        self._engaged_ns = self.clock.t_ns
        self._asking.append(self.loop.create_task(service.flight.wishes.engage()))

    def advance(self, to_ns: int) -> None:
        while self._step_ns <= to_ns:
            self.clock.t_ns = max(self.clock.t_ns, self._step_ns)
            pause = self._begin_faults()
            self._turn(alone=False)
            self._step_ns += self.scenario.step_ns
            if pause is not None:
                self._stand_still(pause)
                to_ns = max(to_ns, self.clock.t_ns)
        self.clock.t_ns = max(self.clock.t_ns, to_ns)

    def note_tick(self, service: Service, told: VehicleState) -> None:
        now_ns, commander = self.clock.t_ns, self.vehicle.commander
        ready = (
            service.sar.is_ready, not service.failed, service.senses.is_related, not commander.estimator.broken,
            now_ns - self.vehicle.checks_passed_ns <= _CHECKS_S * NS_PER_S,
        )  # fmt: skip
        if service.flight.state not in _AT_REST:
            self._flew_ns = now_ns
        self.trace.entries.append(
            Ticked(
                t_ns=now_ns, told=told, state=service.flight.state, really=commander.mode,
                intention=commander.intention, armed=commander.armed, pose_silent_s=(now_ns - self._pose_ns) / NS_PER_S,
                packet_s=(now_ns - self._packet_ns) / NS_PER_S, datagram_s=(now_ns - self._datagram_ns) / NS_PER_S,
                ready=ready,
            )
        )  # fmt: skip

    def _turn(self, alone: bool) -> None:
        """One step of the world; `alone`, while our program stands still, only the vehicle's."""
        self.vehicle.step()
        history = self.vehicle.commander.history
        while self._modes_seen < len(history):
            armed = self.vehicle.commander.armed
            self.trace.entries.append(Moded(self.clock.t_ns, history[self._modes_seen][1], armed))
            self._modes_seen += 1
        self.vehicle.tell()
        service = None if alone else self.service
        if self.reality is not None:
            self.reality.go_on(self, service)
        if service is not None:
            service.senses.turn(self, service)

    def note_packet(self) -> None:
        self._packet_ns = self.clock.t_ns

    def note_datagram(self) -> None:
        self._datagram_ns = self.clock.t_ns

    def give_poses(self, service: Started, poses: Sequence[Pose]) -> None:
        """The tracker's, with what is wrong with it now."""
        word = self.word("poses")
        if word == "silent":
            return
        for true in poses:
            pose = self._tracker.pose(true, word)
            if word not in ("nan", "failed"):
                self._pose_ns = true.t_mono_ns
            service.intake.take(pose)

    def lasts(self, kind: str) -> bool:
        return kind in self._words

    def word(self, kind: str) -> str:
        return self._words.get(kind, "")

    def _stand_still(self, pause: Fault) -> None:
        """The event loop alone, the whole process, or (`suspend`) our clock with it."""
        step_ns = self.scenario.step_ns
        steps = round((0.1 + 4.0 * pause.size**2) * NS_PER_S / step_ns)
        telemetry = self.vehicle.telemetry
        self.vehicle.telemetry = telemetry if pause.word == "loop" else None
        for _ in range(steps):
            if pause.word == "suspend":
                self.clock.suspended_ns += step_ns
            else:
                self.clock.t_ns += step_ns
                self._step_ns = self.clock.t_ns + step_ns
            self._turn(alone=True)
        self.vehicle.telemetry = telemetry
        self._disturb(0.0, "pause")

    def _disturb(self, for_s: float, kind: str) -> None:
        if kind in LINK_FAULTS:
            self.trace.quiet_ns = max(self.trace.quiet_ns, self.clock.t_ns + round(for_s * NS_PER_S))

    def _begin_faults(self) -> Fault | None:
        now_ns, pause = self.clock.t_ns, None
        was = len(self._lasting), self._switch_up
        ended = [one for one in self._lasting if one[0] <= now_ns] if self._lasting else []
        for until_ns, fault in ended:
            self._lasting.remove((until_ns, fault))
            self.trace.entries.append(Faulted(now_ns, fault, False))
        while self._faults and self._start_ns + self._faults[0].at_s * NS_PER_S <= now_ns:
            fault = self._faults.pop(0)
            self.trace.entries.append(Faulted(now_ns, fault, True))
            self._disturb(fault.for_s, fault.kind)
            if fault.for_s:
                self._lasting.append((now_ns + round(fault.for_s * NS_PER_S), fault))
            elif fault.kind == "pause":
                pause = fault
            else:
                self._happen(fault)
        if ended or self._applied_to is not self.service or was != (len(self._lasting), self._switch_up):
            self._applied_to = self.service
            self._apply()
        return pause

    def _apply(self) -> None:
        """What lasts, as it is now."""
        vehicle, service = self.vehicle, self.service
        self._words = {fault.kind: fault.word for _, fault in reversed(self._lasting)}
        vehicle.mute, vehicle.commands, vehicle.offboard = map(self.word, ("mute", "commands", "offboard"))
        vehicle.is_deaf = self.lasts("deaf")
        vehicle.parameters_silent = self.word("parameters") == "silent"
        vehicle.commander.parameters["COM_OF_LOSS_T"] = 10.0 if self.word("parameters") == "wrong" else 1.0
        vehicle.commander.parameters["RTL_RETURN_ALT"] = 30.0 if self.word("parameters") == "high" else 2.0
        vehicle.let_fail(tuple(fault.word for _, fault in self._lasting if fault.kind == "checks"))
        vehicle.commander.estimator.broken = self.lasts("estimator")
        wind = next((fault for _, fault in self._lasting if fault.kind == "wind"), None)
        angle = 0.0 if wind is None else math.tau * wind.size
        force_m_s2 = 0.0 if wind is None else 2.0 + 6.0 * wind.size
        vehicle.wind_m_s2 = (force_m_s2 * math.cos(5 * angle), force_m_s2 * math.sin(5 * angle))
        vehicle.batteries = dict(_BATTERIES.get(self.word("battery"), {0: 0.9}))
        was_up, vehicle.up = vehicle.up, None if self.lasts("rc") else self._switch_up
        if was_up is not vehicle.up:
            self.trace.entries.append(Switched(self.clock.t_ns, vehicle.up))
        if service is not None:
            service.failed = self.lasts("recorder")
            service.link.is_closed = self.lasts("closed")
            service.senses.apply(self)
            ready = service.senses.worker.ready
            (ready.clear if self.word("worker") == "gone" else ready.set)()

    def _happen(self, fault: Fault) -> None:
        vehicle, service = self.vehicle, self.service
        match fault.kind:
            case "reboot":
                vehicle.reboot(6.0 * fault.size)
                self._disturb(6.0 * fault.size, "reboot")
            case "pilot":
                vehicle.commander.pilot_mode(Mode[fault.word])
            case "sticks":
                vehicle.commander.sticks((fault.size, 0.3, 0.2))
            case "switch":
                self._switch_up = not self._switch_up
            case "jump":
                self._tracker.jump(0.2 + fault.size)
            case "reset":
                vehicle.commander.estimator.reset_by((2.0 * fault.size - 1.0, 0.5, 0.0))
            case "abort" if service is not None:
                service.flight.wishes.abort()
            case "engage" if service is not None:
                self._engage(service)
            case "stop" | "kill" if service is not None and self._ending is None:
                self._ending = self.loop.create_task(self._restart(fault.kind, 0.2 + 3.0 * fault.size))

    async def _restart(self, how: str, after_s: float) -> None:
        await self._end(how)
        await asyncio.sleep(after_s)
        self.service, self._ending = Service(self), None

    async def _end(self, how: str) -> None:
        service, self.service = self.service, None
        if service is None:
            return
        flight = service.flight
        was_flying = flight._streaming
        self.trace.entries.append(Served(self.clock.t_ns, how, was_flying, service.edge.state()))
        service.link.is_killed = how == "kill"
        for task in service.tasks[1:] + service.tasks[:1]:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        service.link.is_killed = True
        self.trace.entries.append(Served(self.clock.t_ns, "has ended", was_flying, service.edge.state()))
