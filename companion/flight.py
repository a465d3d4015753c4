"""The flying robot's 20 Hz loop: conditions -> mission -> actions, and one set point through the gate."""

from __future__ import annotations

import asyncio
import functools
import logging
import math
from collections.abc import Coroutine
from dataclasses import asdict, dataclass
from typing import Any

from companion import mission
from companion.approach import Approach
from companion.autopilot.port import Autopilot, AutopilotError, GaveWayError
from companion.clock import NS_PER_S, Ticker
from companion.conditions import ConditionLimits, Situation, conditions
from companion.config import Config
from companion.event_clock import EventClock
from companion.events import CommandOutcome, Tick, Wish
from companion.gate import Gate, GateLimits
from companion.messages import FlightMode, VehicleState
from companion.mission import Action, Event, State
from companion.node import Node
from companion.recorder import Recorder
from companion.sar import ApertureRecord, Iteration, SarIterations
from companion.streams import APERTURE, BEARING, COMMAND, GATE, MISSION, PROFILE, SETPOINT, TARGET, TICK, WISH
from companion.tracker import Bearing, Target, TargetReport, TargetTracker
from companion.vehicle_commands import Commands

_log = logging.getLogger(__name__)
_RATE_HZ = 20.0
_WARM_UP_S = 1.0  # PX4 wants a running stream before it lets anybody into OFFBOARD
_LEAVE_S = 0.5
_WISHES = frozenset({Event.ENGAGE})
_AT_REST = frozenset({State.IDLE, State.PREFLIGHT, State.LATCHED, State.FAULT})
_SEARCH_TURN_RAD = math.radians(120.0)


@dataclass(frozen=True, slots=True)
class MissionStep:
    """One transition of the mission, for the log."""

    t_mono_ns: int
    state: State
    event: Event
    next_state: State
    actions: tuple[Action, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class GateReport:
    """A change of what the gate says, for the log: the reasons now, none when set points pass again."""

    t_mono_ns: int
    reasons: tuple[str, ...]


class Flight:
    """Owns the mission state and the one set point stream."""

    def __init__(
        self,
        config: Config,
        clock: EventClock,
        node: Node,
        autopilot: Autopilot,
        commands: Commands,
        sar: SarIterations,
        recorder: Recorder,
    ) -> None:
        self._config = config
        self._clock = clock
        self._node = node
        self._autopilot = autopilot
        self._sar = sar
        self._recorder = recorder
        self._gate = Gate(GateLimits(**asdict(config.gate)))
        self._approach = Approach(sar, config.mission, config.aperture.length_m, config.aperture.settle_s)
        self._tracker = TargetTracker()
        self._limits = ConditionLimits(
            config.pose.lost_s,
            config.aperture.silent_s,
            config.aperture.blind_legs,
            config.mission.min_battery,
            config.mission.limit_s,
        )
        self._ticker = Ticker(clock, _RATE_HZ)
        self.state = State.IDLE
        self._state_ns = clock.now_ns()
        self._reason = ""
        self._pending: list[Event] = []
        self._commands = commands
        self._streaming = False
        self._took_off = False
        self._refusals: tuple[str, ...] = ()
        self._packet_ns: int | None = None
        self._packets = 0
        self._blind_legs = 0
        self._tries = 0
        self._tick_ns: int | None = None
        self._stream_ns: int | None = None
        """The stream's last tick; None while there is none."""
        self._iteration: Iteration | None = None
        self._target: Target | None = None

    async def run(self) -> None:
        """Ticks until cancelled. However it ends, the vehicle is left in Hold if the stream was flying it."""
        async with self._commands:
            try:
                async for now_ns in self._ticker.ticks():
                    self.tick(now_ns)
            finally:
                if self._streaming:
                    self._streaming = False
                    await self._leave_at_end()

    def is_ticking(self) -> bool:
        """Whether the loop has ticked within the last second."""
        return self._age_s(self._tick_ns) < 1.0

    def wish(self, event: Event) -> str:
        """A person's `engage` or `abort`. Returns why it is refused, or nothing; it takes effect at the next tick."""
        with self._clock.event() as now_ns:
            refusal = self._refusal(event)
            self._recorder.record(WISH, now_ns, Wish(now_ns, event, refusal))
            if not refusal:
                self._pending.append(event)
            return refusal

    def _refusal(self, event: Event) -> str:
        if event is Event.ENGAGE:
            if self.state not in (State.IDLE, State.LATCHED):
                return f"the mission is {self.state} already"
            return "; ".join(self.not_ready())
        return ""

    def not_ready(self) -> list[str]:
        """What is missing for an engagement, in words."""
        vehicle = self._autopilot.state()
        silent_s, battery = self._config.aperture.silent_s, vehicle.battery_remaining
        checks = {
            "no heartbeat of the autopilot": vehicle.heartbeat_mono_ns is None,
            "the autopilot has no local position": vehicle.p_local_enu_m is None,
            "no fresh poses": self._node.pose_age_s() > self._config.pose.stale_s,
            "the battery is low": battery is not None and battery < self._config.mission.min_battery,
            "the autopilot is in a failsafe": vehicle.failsafe,
            "no datagrams of the target": self._datagram_age_s() > silent_s,
            "no packets of the target": self._age_s(self._packet_ns) > silent_s,
            "the AOA worker is not ready": not self._sar.is_ready,
        }
        return [reason for reason, is_missing in checks.items() if is_missing]

    def status(self) -> dict[str, Any]:
        """For a person: what is going on, angles in degrees."""
        iteration, target = self._iteration, self._target
        bearing = None
        if iteration is not None and iteration.estimate is not None:
            estimate = iteration.estimate
            bearing = {
                "azimuth_deg": math.degrees(estimate.azimuth_rad),
                "elevation_deg": math.degrees(estimate.polar_rad),
                "reliability": estimate.reliability,
                "iteration": iteration.number,
            }
        return {
            "state": self.state,
            "reason": self._reason,
            "not_ready": self.not_ready(),
            "packets": self._packets,
            "path_m": self._sar.path_length_m(),
            "bearing": bearing,
            "target_range_m": target.range_m if target is not None and math.isfinite(target.range_m) else None,
            "streaming": self._streaming,
            "overruns": self._ticker.overruns,
        }

    def heard(self, peer: int, t_mono_ns: int) -> None:
        """A packet of `peer` was measured."""
        if peer == self._config.target:
            self._packet_ns = t_mono_ns
            self._packets += 1

    def take_aperture(self, aperture: ApertureRecord) -> None:
        """An aperture goes to the worker."""
        self._recorder.record(APERTURE, aperture.end_ns, aperture)

    def take(self, iteration: Iteration, profile: bytes) -> None:
        """A SAR iteration has ended."""
        self._recorder.record(BEARING, iteration.reference_ns, iteration)
        if profile:
            self._recorder.record(PROFILE, iteration.reference_ns, profile)
        if iteration.peer != self._config.target:
            return
        self._packets = 0
        self._blind_legs += 1
        if iteration.estimate is None:
            _log.warning("SAR iteration %d refused: %s", iteration.number, iteration.refusal)
            return
        self._iteration = iteration
        bearing = iteration.bearing()
        if bearing is not None and iteration.estimate.reliability >= self._config.aperture.min_reliability:
            self._target = self._tracker.add(bearing)
            self._recorder.record(TARGET, bearing.t_mono_ns, _target_report(iteration, bearing, self._target))
            self._blind_legs = self._tries = 0
            self._pending.append(Event.BEARING)

    def tick(self, now_ns: int) -> None:
        """One turn of the control loop."""
        with self._clock.event(now_ns):
            self._recorder.record(TICK, now_ns, Tick(now_ns))
            self._turn(now_ns)

    def _turn(self, now_ns: int) -> None:
        self._tick_ns = now_ns
        vehicle = self._autopilot.state()
        if vehicle.p_local_enu_m is not None and vehicle.position_mono_ns is not None:
            self._sar.add_local_position(vehicle.position_mono_ns, vehicle.p_local_enu_m)
        self._took_off |= self.state is State.TAKING_OFF and (vehicle.in_air or vehicle.mode is FlightMode.TAKEOFF)
        event = self._worst_event(vehicle, now_ns)
        if event is not None:
            self._step(event, vehicle, now_ns)
        if self._streaming:
            self._send_setpoint(vehicle, now_ns)
        self._stream_ns = now_ns if self._streaming else None

    def _worst_event(self, vehicle: VehicleState, now_ns: int) -> Event | None:
        """The worst that holds now or was reported. A report that has no meaning in this state is dropped; one that
        lost against a worse one waits, but for a person's wish, which must then be made again."""
        events = conditions(self.state, self._situation(vehicle, now_ns), self._limits) + self._pending
        event = mission.worst(self.state, events)
        self._pending = [e for e in self._pending if e is not event and e not in _WISHES] if event is not None else []
        return event

    def _situation(self, vehicle: VehicleState, now_ns: int) -> Situation:
        return Situation(
            vehicle=vehicle,
            now_ns=now_ns,
            in_state_s=(now_ns - self._state_ns) / NS_PER_S,
            took_off=self._took_off,
            pose_age_s=self._node.pose_age_s(),
            target_age_s=max(self._age_s(self._packet_ns), self._datagram_age_s()),
            blind_legs=self._blind_legs,
            tries=self._tries,
            stream_gap_s=0.0 if self._stream_ns is None else (now_ns - self._stream_ns) / NS_PER_S,
            target_near=self._is_near(vehicle),
        )

    def _is_near(self, vehicle: VehicleState) -> bool:
        """Whether the target, where its newest datagram says it has come to, is within the range of arrival."""
        target = self._target
        newest = self._node.receiver.neighbours[self._config.target].newest_pose()
        if target is None or newest is None or vehicle.p_local_enu_m is None or newest[0] != target.boot:
            return False
        range_m = target.range_from(vehicle.p_local_enu_m, newest[1])
        return range_m + 2 * target.range_std_m < self._config.mission.arrival_range_m

    def _step(self, event: Event, vehicle: VehicleState, now_ns: int) -> None:
        before = self.state
        self.state, actions = mission.step(before, event)
        if self.state is not before:
            self._state_ns = now_ns
            self._reason = f"{event}: {self._reason}" if event in _FAILURES else str(event)
            _log.info("mission: %s -> %s on %s", before, self.state, event)
            if self.state is State.HOLDING:
                self._tries += 1
            if self.state in _AT_REST:
                self._pending.clear()  # what was reported of the flight that has ended
                self._commands.cancel()
        if event is Event.BEARING_BACK:
            self._blind_legs = self._config.aperture.blind_legs - 1  # one more leg may be flown to measure anew
        self._recorder.record(MISSION, now_ns, MissionStep(now_ns, before, event, self.state, actions, self._reason))
        for action in actions:
            self._act(action, vehicle)

    def _act(self, action: Action, vehicle: VehicleState) -> None:
        match action:
            case Action.RUN_PREFLIGHT:
                self._took_off = vehicle.in_air
                self._tracker, self._target = TargetTracker(), None
                self._blind_legs = self._tries = 0
                missing = self.not_ready()
                self._reason = "; ".join(missing)
                self._pending.append(Event.PREFLIGHT_FAILED if missing else Event.PREFLIGHT_PASSED)
            case Action.ARM_AND_TAKE_OFF:
                self._start(self._take_off(), Event.AIRBORNE, Event.TAKEOFF_FAILED)
            case Action.STREAM_START:
                assert vehicle.p_local_enu_m is not None
                self._approach.start(vehicle.p_local_enu_m, vehicle.yaw_enu_rad or 0.0)
                self._streaming = True
            case Action.REQUEST_OFFBOARD:
                self._start(self._enter_offboard(), Event.OFFBOARD_CONFIRMED, Event.OFFBOARD_REFUSED)
            case Action.STREAM_STOP:
                self._streaming = False
                self._sar.start_ns = None
                self._commands.cancel()
            case Action.LEAVE_TO_HOLD:
                self._start(self._hold_or_land(), None, None)
            case Action.LAND:
                self._start(self._autopilot.land(), None, None)

    def _send_setpoint(self, vehicle: VehicleState, now_ns: int) -> None:
        moving = self.state in (State.ACQUIRING, State.APPROACHING)
        setpoint = self._approach.setpoint(now_ns, self._azimuth_rad(vehicle), moving)
        ours = self.state is State.TAKING_OFF or vehicle.mode is FlightMode.OFFBOARD
        verdict = self._gate.check(setpoint, vehicle, now_ns, ours)
        if verdict.reasons != self._refusals:
            self._note_refusal(verdict.reasons, vehicle, now_ns)
        if verdict.setpoint is not None:
            self._autopilot.send_setpoint(verdict.setpoint)
            self._recorder.record(SETPOINT, now_ns, verdict.setpoint)

    def _note_refusal(self, reasons: tuple[str, ...], vehicle: VehicleState, now_ns: int) -> None:
        """The path has left what the gate allows: the leg is given up, and the next begins where the vehicle is."""
        if reasons and not self._refusals:
            self._reason = f"gate: {'; '.join(reasons)}"
            _log.warning(self._reason)
            self._blind_legs += 1
            self._sar.start_ns = None
            if vehicle.p_local_enu_m is not None:
                self._approach.start(vehicle.p_local_enu_m, vehicle.yaw_enu_rad or 0.0)
        self._refusals = reasons
        self._recorder.record(GATE, now_ns, GateReport(now_ns, reasons))

    def _azimuth_rad(self, vehicle: VehicleState) -> float:
        """Where the next leg goes: to the target, or into a new direction each time while nothing is known of it."""
        if self._target is not None:
            return self._target.azimuth_rad
        return (vehicle.yaw_enu_rad or 0.0) + _SEARCH_TURN_RAD * self._blind_legs

    async def _take_off(self) -> None:
        if not self._autopilot.state().in_air:
            await self._autopilot.arm()
        await self._autopilot.takeoff(self._config.mission.takeoff_height_m)

    async def _enter_offboard(self) -> None:
        await self._clock.sleep_until_ns(self._clock.now_ns() + round(_WARM_UP_S * NS_PER_S))
        await self._autopilot.request_offboard()

    def _start(self, command: Coroutine[Any, Any, None], done: Event | None, failed: Event | None) -> None:
        """Runs one command to the autopilot beside the loop; a newer command replaces an older one."""
        self._commands.start(command, functools.partial(self._take_outcome, done, failed))

    def _take_outcome(self, done: Event | None, failed: Event | None, error: AutopilotError | None) -> None:
        event = done if error is None else failed
        with self._clock.event() as now_ns:
            self._recorder.record(COMMAND, now_ns, CommandOutcome(now_ns, event, "" if error is None else str(error)))
            if error is not None:
                _log.error("%s", error)
                self._reason = str(error)
            if event is not None:
                self._pending.append(event)

    async def _hold_or_land(self) -> None:
        try:
            await self._autopilot.hold()
        except GaveWayError:
            raise
        except AutopilotError as error:
            _log.error("%s; landing instead", error)  # hold needs a position, landing does not
            await self._autopilot.land()

    async def _leave_at_end(self) -> None:
        self._commands.cancel()
        try:
            async with asyncio.timeout(_LEAVE_S):
                await self._hold_or_land()
        except (AutopilotError, TimeoutError):
            _log.error("Hold was commanded but not confirmed; the autopilot's loss-of-stream failsafe takes over")

    def _datagram_age_s(self) -> float:
        return self._age_s(self._node.receiver.neighbours[self._config.target].heard_ns)

    def _age_s(self, t_ns: int | None) -> float:
        return math.inf if t_ns is None else (self._clock.now_ns() - t_ns) / NS_PER_S


_FAILURES = frozenset({Event.PREFLIGHT_FAILED, Event.TAKEOFF_FAILED, Event.OFFBOARD_REFUSED})


def _target_report(iteration: Iteration, bearing: Bearing, target: Target) -> TargetReport:
    place = None
    if target.origin_local_enu_m is not None:
        x, y, z = (o + q for o, q in zip(target.origin_local_enu_m, bearing.target_p_enu_m, strict=True))
        place = (x, y, z)
    return TargetReport(bearing.t_mono_ns, iteration.number, target, place)
