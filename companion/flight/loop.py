"""The flying robot's 20 Hz loop: conditions -> mission -> actions, and one set point through the gate.

Longer than other modules: everything that may command the vehicle is to be read in one place.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from companion.autopilot.port import Autopilot, AutopilotError
from companion.autopilot.silent import SilentAutopilot
from companion.config.schema import Config
from companion.core.clock import NS_PER_S, Clock, Ticker
from companion.core.event_clock import EventClock
from companion.core.inputs import CommandOutcome, Event, Surroundings, Tick, Wish
from companion.core.messages import FlightMode, Setpoint, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import (
    APERTURE,
    AUTOPILOT_EVENT,
    BEARING,
    COMMAND,
    END,
    GATE,
    MISSION,
    OBSERVED,
    PROFILE,
    SETPOINT,
    TARGET,
    TICK,
    WISH,
)
from companion.flight.commands import FlightCommands, MakeCommands
from companion.flight.engagement import Engagement
from companion.flight.observer import Observer, would_be_setpoint
from companion.flight.rc_switch import RcSwitch
from companion.flight.records import SERVICE_ENDS, GateReport, MissionStep, ObservedSetpoint, target_report
from companion.guidance.approach import Approach, as_velocity, inside
from companion.guidance.targets import Targets
from companion.mission import table
from companion.mission.conditions import ConditionLimits, Situation, conditions
from companion.mission.table import Action, State
from companion.neighbours.neighbour import Neighbour
from companion.pose.intake import PoseIntake
from companion.safety.gate import Gate, GateLimits, Reason
from companion.sensing.iterations import SarIterations
from companion.sensing.records import ApertureRecord, Iteration

_log = logging.getLogger(__name__)
_RATE_HZ = 20.0
_WISHES = frozenset({Event.ENGAGE})
_AT_REST = frozenset({State.IDLE, State.PREFLIGHT, State.LATCHED, State.FAULT})
_SEARCH_TURN_RAD = math.radians(120.0)
_LEAVE_MODES = {"hold": FlightMode.HOLD, "land": FlightMode.LAND, "return": FlightMode.RETURN}
_BEARING_LATE_S = 1.5
_REFUSED_AGAIN_S = 5.0
_RC_S = 1.0
"""RC_CHANNELS come at 5 Hz. After a longer silence how the switch stands is not known."""


class Flight:
    """Owns the mission state and the one set point stream."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        intake: PoseIntake,
        neighbours: Mapping[int, Neighbour],
        autopilot: Autopilot,
        sar: SarIterations,
        recorder: Recorder,
        make_commands: MakeCommands = FlightCommands,
        look: Callable[[], Surroundings] | None = None,
        network_problem: Callable[[], str] = str,
    ) -> None:
        """A replay runs no commands and gives a `look` of its own at what was around."""
        assert config.autopilot is not None
        self._config = config
        self._clock = clock = EventClock.over(clock)
        self._intake = intake
        self._target_neighbour = neighbours[config.target]
        self._observes = config.mission.control == "observe"
        self._autopilot: Autopilot = SilentAutopilot(autopilot) if self._observes else autopilot
        self._sar = sar
        self._recorder = recorder
        self._gate = Gate(GateLimits(**asdict(config.gate)))
        self._approach = Approach(sar, config.mission, config.aperture.length_m, config.aperture.settle_s)
        self._observer = Observer(sar, config.aperture)
        self._targets = Targets(neighbours, config.target)
        self._limits = ConditionLimits(
            config.pose.stale_s,
            config.pose.lost_s,
            config.aperture.silent_s,
            config.aperture.blind_legs,
            config.mission.min_battery,
            config.mission.limit_s,
            config.mission.hold_limit_s,
            frozenset({_LEAVE_MODES[config.mission.leave]}),
        )
        self._ticker = Ticker(clock, _RATE_HZ)
        self._engagement = Engagement(
            config, clock, intake, neighbours, self._autopilot, sar, recorder, look, network_problem
        )
        self._commands = make_commands(self._autopilot, clock, self._report)
        channel = config.autopilot.engage_rc_channel
        self._switch = None if channel is None else RcSwitch(channel, config.autopilot.engage_rc_above_us)
        self.state = State.IDLE
        self._state_ns = clock.now_ns()
        self._reason = ""
        self._pending: list[Event] = []
        self._aborts = 0
        self._streaming = False
        self._took_off = False
        self._refusals: tuple[str, ...] = ()
        self._refused_ns: int | None = None
        self._packet_ns: int | None = None
        self._packets = 0
        self._blind_legs = 0
        self._tries = 0
        self._tick_ns: int | None = None
        self._stream_ns: int | None = None
        """The stream's last tick; None while there is none."""
        self._iteration: Iteration | None = None

    async def run(self) -> None:
        """Ticks until cancelled. However it ends, the vehicle is left in Hold if we were flying it."""
        async with self._commands:
            try:
                async for now_ns in self._ticker.ticks():
                    self.tick(now_ns)
            finally:
                await self._leave_at_end()

    def is_ticking(self) -> bool:
        """Whether the loop has ticked within the last second."""
        return self._age_s(self._tick_ns) < 1.0

    async def engage(self) -> str:
        """A person's wish to hand over the vehicle. Returns the whole list of what stands against it, or nothing; then
        it takes effect at the next tick."""
        return self.take_wish(Event.ENGAGE, await self._engage_refusal())

    def abort(self) -> None:
        """A person's wish to end the flight; it takes effect at the next tick."""
        self._aborts += 1
        self.take_wish(Event.ABORT, "")

    def take_wish(self, wish: Event, refusal: str, by_switch: bool = False) -> str:
        """A wish has been answered; a granted one takes effect at the next tick."""
        with self._clock.event() as now_ns:
            self._recorder.record(WISH, now_ns, Wish(now_ns, wish, refusal, by_switch))
            if not refusal:
                self._pending.append(wish)
            elif by_switch:
                self._reason = f"the switch did not engage: {refusal}"
                _log.warning(self._reason)
        return refusal

    async def _engage_refusal(self) -> str:
        if self.state not in (State.IDLE, State.LATCHED):
            return f"the mission is {self.state} already"
        aborts, missing = self._aborts, self.not_ready() + await self._engagement.parameter_problems()
        # Reading parameters takes a moment, and an abort means nothing to a mission that is still at rest.
        return "; ".join(missing + (["it was aborted meanwhile"] if self._aborts != aborts else []))

    def not_ready(self) -> list[str]:
        """What is missing for an engagement, in words, but for the autopilot's parameters, which must be asked for."""
        return self._engagement.not_ready(self._age_s(self._packet_ns), self._datagram_age_s())

    def status(self) -> dict[str, Any]:
        """For a person: what is going on, angles in degrees."""
        iteration, target = self._iteration, self._targets.target
        bearing = None
        if iteration is not None and iteration.estimate is not None:
            estimate = iteration.estimate
            bearing = {
                "azimuth_deg": math.degrees(estimate.azimuth_rad),
                "elevation_deg": 90.0 - math.degrees(estimate.polar_rad),
                "reliability": estimate.reliability,
                "iteration": iteration.number,
                "reference_ns": iteration.reference_ns,
            }
        return {
            "state": self.state,
            "control": self._config.mission.control,
            "reason": self._reason,
            "not_ready": self.not_ready(),
            "packets": self._packets,
            "path_m": self._sar.path_length_m(),
            "bearing": bearing,
            "bearing_stale": self._bearing_stale(),
            "target_range_m": target.range_m if target is not None and math.isfinite(target.range_m) else None,
            "streaming": self._streaming,
            "vehicle": self._vehicle(),
            "overruns": self._ticker.overruns,
        }

    def _vehicle(self) -> dict[str, Any]:
        state = self._autopilot.state()
        return {
            "mode": state.mode,
            "armed": state.armed,
            "in_air": state.in_air,
            "p_local_enu_m": state.p_local_enu_m,
            "v_local_enu_m_s": state.v_local_enu_m_s,
            "yaw_enu_rad": state.yaw_enu_rad,
            "battery": state.battery_remaining,
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
        bearing, estimate = iteration.bearing(), iteration.estimate
        steers = bearing is not None and estimate is not None
        steers = steers and estimate.reliability >= self._config.aperture.min_reliability  # type: ignore[union-attr]
        if steers:
            assert bearing is not None
            report = target_report(iteration, bearing, self._targets.add(iteration.peer, bearing))
            self._recorder.record(TARGET, bearing.t_mono_ns, report)
        if iteration.peer == self._config.target:
            self._note_iteration(iteration, steers)

    def _note_iteration(self, iteration: Iteration, steers: bool) -> None:
        self._packets = 0
        self._blind_legs += 1
        if iteration.estimate is None:
            _log.warning("SAR iteration %d refused: %s", iteration.number, iteration.refusal)
            return
        self._iteration = iteration
        if steers:
            self._blind_legs = self._tries = 0
            self._pending.append(Event.BEARING)

    def tick(self, now_ns: int) -> None:
        """One turn of the control loop."""
        with self._clock.event(now_ns):
            self._recorder.record(TICK, now_ns, Tick(now_ns))
            self._turn(now_ns)

    def end(self) -> bool:
        """The loop ends, because the service is stopped or because any of its parts has failed. Whether we flew."""
        with self._clock.event() as now_ns:
            self._recorder.record(END, now_ns, Tick(now_ns))
            flying = self._streaming or (self.state is State.TAKING_OFF and self._took_off)
            before, self._streaming = self.state, False
            self.state, actions = table.step(before, Event.TASK_FAILED)
            step = MissionStep(now_ns, before, Event.TASK_FAILED, self.state, actions, SERVICE_ENDS)
            self._recorder.record(MISSION, now_ns, step)
            return flying

    def _turn(self, now_ns: int) -> None:
        self._tick_ns = now_ns
        vehicle = self._autopilot.state()
        for event in self._autopilot.take_events():
            self._recorder.record(AUTOPILOT_EVENT, event.t_mono_ns, event)
        if vehicle.p_local_enu_m is not None and vehicle.position_mono_ns is not None:
            self._sar.add_local_position(vehicle.position_mono_ns, vehicle.p_local_enu_m)
        if vehicle.yaw_enu_rad is not None and self._age_s(vehicle.position_mono_ns) < 0.5:
            self._intake.add_heading(now_ns, vehicle.yaw_enu_rad)
        self._took_off |= self.state is State.TAKING_OFF and (vehicle.in_air or vehicle.mode is FlightMode.TAKEOFF)
        self._watch_switch(vehicle)
        worst = self._worst_event(vehicle, now_ns)
        if worst is not None:
            self._step(worst, vehicle, now_ns)
        if self._streaming:
            self._send_setpoint(vehicle, now_ns)
        elif self._observes:
            self._observe(vehicle, now_ns)
        self._stream_ns = now_ns if self._streaming else None

    def _watch_switch(self, vehicle: VehicleState) -> None:
        if self._switch is None:
            return
        # What was heard last says nothing of how the switch stands now.
        wish = self._switch.update(vehicle.rc_us if self._age_s(vehicle.rc_mono_ns) <= _RC_S else ())
        if wish is Event.ENGAGE:
            self._commands.beside(self._engage_by_switch(), "engage by switch")
        elif wish is not None:
            self._aborts += 1
            self._pending.append(wish)

    async def _engage_by_switch(self) -> None:
        self.take_wish(Event.ENGAGE, await self._engage_refusal(), by_switch=True)

    def _worst_event(self, vehicle: VehicleState, now_ns: int) -> Event | None:
        """The worst that holds now or was reported. A report that has no meaning in this state is dropped; one that
        lost against a worse one waits, but for a person's wish, which must then be made again."""
        events = conditions(self.state, self._situation(vehicle, now_ns), self._limits) + self._pending
        event = table.worst(self.state, events)
        self._pending = [e for e in self._pending if e is not event and e not in _WISHES] if event is not None else []
        return event

    def _situation(self, vehicle: VehicleState, now_ns: int) -> Situation:
        p_m = vehicle.p_local_enu_m
        return Situation(
            vehicle=vehicle,
            now_ns=now_ns,
            in_state_s=(now_ns - self._state_ns) / NS_PER_S,
            took_off=self._took_off,
            pose_age_s=self._intake.age_s(),
            pose_failed=self._intake.is_lost(),
            target_age_s=max(self._age_s(self._packet_ns), self._datagram_age_s()),
            blind_legs=self._blind_legs,
            tries=self._tries,
            stream_gap_s=0.0 if self._stream_ns is None else (now_ns - self._stream_ns) / NS_PER_S,
            target_near=p_m is not None and self._targets.is_near(p_m, self._config.mission.arrival_range_m),
        )

    def _step(self, event: Event, vehicle: VehicleState, now_ns: int) -> None:
        before = self.state
        self.state, actions = table.step(before, event)
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
        commands, config = self._commands, self._config.mission
        match action:
            case Action.RUN_PREFLIGHT:
                self._took_off = vehicle.in_air
                self._targets.forget()
                self._blind_legs = self._tries = 0
                self._check_again()
            case Action.ARM_AND_TAKE_OFF:
                commands.start(commands.take_off(config.takeoff_height_m), Event.AIRBORNE, Event.TAKEOFF_FAILED)
            case Action.STREAM_START:
                assert vehicle.p_local_enu_m is not None
                self._approach.start(vehicle.p_local_enu_m, vehicle.yaw_enu_rad or 0.0)
                self._streaming = True
            case Action.REQUEST_OFFBOARD:
                commands.start(commands.enter_offboard(), Event.OFFBOARD_CONFIRMED, Event.OFFBOARD_REFUSED)
            case Action.STREAM_STOP:
                self._streaming = False
                self._sar.start_ns = None
                commands.cancel()
            case Action.LEAVE_TO_HOLD:
                commands.start(commands.hold())
            case Action.LAND:
                commands.start(commands.land())
            case Action.LEAVE_AT_TARGET:
                leave = {"hold": commands.hold, "land": commands.land, "return": commands.return_home}
                commands.start(leave[config.leave]())
            case Action.LEAVE_WITHOUT_TARGET:
                commands.start(commands.return_home() if config.lost_target == "return" else commands.land())

    def _check_again(self) -> None:
        """The tick's own look at what `engage` has looked at, a moment later and with the parameters it has read."""
        missing = self.not_ready()
        if not self._engagement.parameters_checked:
            missing.append("the autopilot's parameters were not checked")
        self._reason = "; ".join(missing)
        self._pending.append(Event.PREFLIGHT_FAILED if missing else Event.PREFLIGHT_PASSED)

    def _send_setpoint(self, vehicle: VehicleState, now_ns: int) -> None:
        moving = self.state in (State.ACQUIRING, State.APPROACHING)
        setpoint = self._approach.setpoint(now_ns, self._azimuth_rad(vehicle), moving)
        if self._config.mission.setpoints == "velocity" and vehicle.p_local_enu_m is not None:
            setpoint = as_velocity(setpoint, vehicle.p_local_enu_m, self._gate.limits)
        ours = self.state is State.TAKING_OFF or vehicle.mode is FlightMode.OFFBOARD
        verdict = self._gate.check(setpoint, vehicle, now_ns, ours, self._targets.places())
        if verdict.reasons and (not self._refusals or self._age_s(self._refused_ns) >= _REFUSED_AGAIN_S):
            self._refused_ns = now_ns
            self._give_up_leg(verdict.reasons, vehicle)
        if verdict.reasons != self._refusals:
            self._refusals = verdict.reasons
            self._recorder.record(GATE, now_ns, GateReport(now_ns, verdict.reasons))
        if verdict.setpoint is not None:
            self._send(verdict.setpoint)

    def _send(self, setpoint: Setpoint) -> None:
        try:
            self._autopilot.send_setpoint(setpoint)
        except AutopilotError as error:
            self._report(Event.LINK_LOST, str(error))
            return
        self._recorder.record(SETPOINT, setpoint.t_mono_ns, setpoint)

    def _give_up_leg(self, reasons: tuple[Reason, ...], vehicle: VehicleState) -> None:
        """The path has left what the gate allows, and the gate's hold only follows the vehicle. So the next leg begins,
        and the vehicle stands, where it is; in the fence's way, inside it. A path that cannot be flown is a blind leg:
        after enough of them the mission holds, and then leaves."""
        self._reason = f"gate: {'; '.join(reasons)}"
        _log.warning(self._reason)
        self._blind_legs += 1
        self._sar.start_ns = None
        if vehicle.p_local_enu_m is not None:
            self._approach.start(inside(vehicle.p_local_enu_m, self._gate.limits), vehicle.yaw_enu_rad or 0.0)
        if Reason.NEIGHBOUR in reasons and self._is_target_nearest(vehicle):
            self._pending.append(Event.TARGET_REACHED)  # as near as anything may come to it

    def _is_target_nearest(self, vehicle: VehicleState) -> bool:
        assert vehicle.p_local_enu_m is not None  # or the gate would have had no position
        return self._targets.is_nearest(vehicle.p_local_enu_m)

    def _observe(self, vehicle: VehicleState, now_ns: int) -> None:
        self._observer.tick(now_ns)
        target = self._targets.target
        if target is None or vehicle.p_local_enu_m is None:
            return
        wanted = would_be_setpoint(now_ns, vehicle.p_local_enu_m, target.azimuth_rad, self._config.mission)
        verdict = self._gate.check(wanted, vehicle, now_ns, True, self._targets.places())
        self._recorder.record(OBSERVED, now_ns, ObservedSetpoint(now_ns, wanted, verdict.reasons))

    def _azimuth_rad(self, vehicle: VehicleState) -> float:
        """Where the next leg goes: to the target, or into a new direction each time while nothing is known of it."""
        target = self._targets.target
        if target is not None:
            return target.azimuth_rad
        return (vehicle.yaw_enu_rad or 0.0) + _SEARCH_TURN_RAD * self._blind_legs

    def _report(self, event: Event | None, reason: str) -> None:
        """What a command ended in, and why it failed."""
        with self._clock.event() as now_ns:
            self._recorder.record(COMMAND, now_ns, CommandOutcome(now_ns, event, reason))
            self._reason = reason or self._reason
            if event is not None:
                self._pending.append(event)

    async def _leave_at_end(self) -> None:
        if self.end():
            await self._commands.leave_at_end()

    def _bearing_stale(self) -> bool:
        """Whether what is known of the target's direction is old: it is silent, legs gave none, or the worker hangs or
        is gone."""
        if self._iteration is None:
            return True
        silent = max(self._age_s(self._packet_ns), self._datagram_age_s()) > self._config.aperture.silent_s
        late = self._sar.waiting_s() > _BEARING_LATE_S or not self._sar.is_ready
        return silent or late or self._blind_legs >= self._config.aperture.blind_legs

    def _datagram_age_s(self) -> float:
        return self._age_s(self._target_neighbour.heard_ns)

    def _age_s(self, t_ns: int | None) -> float:
        return math.inf if t_ns is None else (self._clock.now_ns() - t_ns) / NS_PER_S


_FAILURES = frozenset({Event.PREFLIGHT_FAILED, Event.TAKEOFF_FAILED, Event.OFFBOARD_REFUSED})
