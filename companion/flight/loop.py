"""The flying robot's 20 Hz loop: all that may command the vehicle; conditions, mission, actions, set point, gate."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

from companion.autopilot.port import Autopilot, AutopilotError
from companion.autopilot.silent import SilentAutopilot
from companion.config.schema import Config
from companion.core.clock import NS_PER_S, HostSleep, Ticker, age_s
from companion.core.event_clock import EventClock
from companion.core.inputs import CommandOutcome, Event, Surroundings, Tick
from companion.core.messages import FlightMode, Setpoint, Vector3, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import AUTOPILOT_EVENT, COMMAND, END, GATE, OBSERVED, SETPOINT, TICK
from companion.flight.commands import FlightCommands, MakeCommands
from companion.flight.course import AT_REST, Course
from companion.flight.engagement import Engagement
from companion.flight.knowledge import Knowledge
from companion.flight.limits import condition_limits
from companion.flight.local_frame import LocalFrame
from companion.flight.observer import would_be_setpoint
from companion.flight.origin import Origin
from companion.flight.rc_switch import RcSwitch
from companion.flight.records import GateReport, ObservedSetpoint
from companion.flight.status import status
from companion.flight.wishes import Wishes
from companion.guidance.approach import Approach, as_velocity, inside
from companion.mission.conditions import SLEPT_S, Situation, conditions
from companion.mission.table import Action, State
from companion.neighbours.neighbour import Neighbour
from companion.pose.intake import PoseIntake
from companion.safety.gate import Gate, GateLimits, Reason
from companion.sensing.iterations import SarIterations

_log = logging.getLogger(__name__)
_RATE_HZ = 20.0
_REFUSED_AGAIN_S = 5.0


class Flight:
    """Owns the one set point stream, and carries out what the mission asks for."""

    def __init__(
        self,
        *,
        config: Config,
        clock: EventClock,
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
        self._clock = clock
        self._intake = intake
        self._observes = config.mission.control == "observe"
        self._autopilot: Autopilot = SilentAutopilot(autopilot) if self._observes else autopilot
        self._sar = sar
        self._recorder = recorder
        self._gate = Gate(GateLimits(**asdict(config.gate)))
        self._approach = Approach(config.mission, self._gate.limits, config.aperture.length_m)
        self._limits = condition_limits(config)
        self._ticker = Ticker(clock, _RATE_HZ)
        self._sleep = HostSleep()
        self._commands = make_commands(self._autopilot, clock, self._report)
        self._course = Course(clock, recorder)
        self._frame = LocalFrame()
        self.knowledge = Knowledge(
            config.aperture, clock, recorder, neighbours, config.target, sar, self._course, config.mission, self._frame
        )
        self._targets = self.knowledge.targets
        self._engagement = Engagement(
            config, clock, intake, self.knowledge, self._autopilot, sar, recorder, look, network_problem
        )
        channel = config.autopilot.engage_rc_channel
        switch = None if channel is None else RcSwitch(channel, config.autopilot.engage_rc_above_us)
        self.wishes = Wishes(clock, recorder, self._course, self._engagement, switch, self._commands.beside)
        self._origin = Origin(self._autopilot, config.autopilot)
        self._streaming = False
        self._took_off = False
        self._stood_still_ns = 0
        """What the vehicle had told of our clock when it was engaged."""
        self._refusals: tuple[str, ...] = ()
        self._refused_ns: int | None = None
        self._tick_ns: int | None = None
        self._stream_ns: int | None = None
        """When the newest set point of the stream went out, or the stream began; in preflight the last tick, since what
        it looked at grows old; else None."""

    @property
    def state(self) -> State:
        return self._course.state

    async def run(self) -> None:
        """Ticks until cancelled. However it ends, the vehicle is left in Hold if we were flying it."""
        async with self._commands:
            try:
                async for now_ns in self._ticker.ticks():
                    self.tick(now_ns, self._sleep.seconds())
            finally:
                if self.end():
                    await self._commands.leave_at_end()

    def is_ticking(self) -> bool:
        """Whether the loop has ticked within the last second."""
        return self._age_s(self._tick_ns) < 1.0

    def status(self) -> dict[str, Any]:
        """For a person: what is going on, angles in degrees."""
        return status(
            course=self._course,
            knowledge=self.knowledge,
            vehicle=self._autopilot.state(),
            control=self._config.mission.control,
            not_ready=self._engagement.not_ready(),
            path_m=self._sar.path_length_m(),
            streaming=self._streaming,
            overruns=self._ticker.overruns,
        )

    def tick(self, now_ns: int, slept_s: float = 0.0) -> None:
        """One turn of the control loop. The host was suspended for `slept_s` since the one before."""
        with self._clock.event(now_ns):
            slept_s = slept_s if slept_s > SLEPT_S else 0.0
            self._recorder.record(TICK, now_ns, Tick(now_ns, slept_s))
            if slept_s:
                self.wishes.outdate()
                _log.warning("the host was suspended for %.1f s", slept_s)
            self._turn(now_ns, slept_s)

    def end(self) -> bool:
        """The loop ends, because the service is stopped or because any of its parts has failed. Whether we flew."""
        with self._clock.event() as now_ns:
            self._recorder.record(END, now_ns, Tick(now_ns))
            flying = self._streaming or (self.state is State.TAKING_OFF and self._took_off)
            self._streaming = False
            self._course.end(now_ns)
            return flying

    def _turn(self, now_ns: int, slept_s: float) -> None:
        self._tick_ns = now_ns
        vehicle = self._autopilot.state()
        for event in self._autopilot.take_events():
            self._recorder.record(AUTOPILOT_EVENT, event.t_mono_ns, event)
        if vehicle.p_local_enu_m is not None and vehicle.position_mono_ns is not None:
            self._sar.add_local_position(vehicle.position_mono_ns, vehicle.p_local_enu_m)
        if vehicle.yaw_enu_rad is not None and self._age_s(vehicle.position_mono_ns) < 0.5:
            self._intake.add_heading(now_ns, vehicle.yaw_enu_rad)
        self._follow_frame(vehicle, now_ns)
        self._origin.tick(vehicle, now_ns)
        self._took_off |= self.state is State.TAKING_OFF and (vehicle.in_air or vehicle.mode is FlightMode.TAKEOFF)
        self.wishes.watch_switch(vehicle)
        worst = self._course.worst(conditions(self.state, self._situation(vehicle, now_ns, slept_s), self._limits))
        if worst is not None:
            self._step(worst, vehicle, now_ns)
        if self._streaming:
            self._send_setpoint(vehicle, now_ns)
        elif self._observes:
            self._observe(vehicle, now_ns)
        if self._streaming:
            self._stream_ns = self._stream_ns or now_ns
        else:
            self._stream_ns = now_ns if self.state is State.PREFLIGHT else None

    def _situation(self, vehicle: VehicleState, now_ns: int, slept_s: float) -> Situation:
        p_m = vehicle.p_local_enu_m
        return Situation(
            vehicle=vehicle,
            now_ns=now_ns,
            in_state_s=age_s(self._course.since_ns, now_ns),
            took_off=self._took_off,
            pose_age_s=self._intake.age_s(),
            pose_failed=self._intake.is_lost(),
            target_age_s=self.knowledge.age_s(),
            blind_legs=self.knowledge.blind_legs,
            tries=self.knowledge.tries,
            stream_gap_s=0.0 if self._stream_ns is None else (now_ns - self._stream_ns) / NS_PER_S,
            stood_still_s=(vehicle.stood_still_ns - self._stood_still_ns) / NS_PER_S,
            slept_s=slept_s,
            target_near=p_m is not None and self._targets.is_near(p_m),
        )

    def _step(self, event: Event, vehicle: VehicleState, now_ns: int) -> None:
        before, actions = self.state, self._course.step(event, now_ns)
        if self.state is not before:
            if self.state is State.HOLDING:
                self.knowledge.note_hold()
            if self.state in AT_REST:
                self._commands.cancel()
        if event is Event.BEARING_BACK:
            self.knowledge.grant_leg()
        for action in actions:
            self._act(action, vehicle)

    def _act(self, action: Action, vehicle: VehicleState) -> None:
        commands, config = self._commands, self._config.mission
        match action:
            case Action.RUN_PREFLIGHT:
                self._took_off, self._stood_still_ns = vehicle.in_air, vehicle.stood_still_ns
                self.knowledge.begin_anew()
                self._engagement.check_again(self._course)
            case Action.ARM_AND_TAKE_OFF:
                commands.start(commands.take_off(config.takeoff_height_m), Event.AIRBORNE, Event.TAKEOFF_FAILED)
            case Action.STREAM_START:
                assert vehicle.p_local_enu_m is not None
                self._begin_path(vehicle.p_local_enu_m, vehicle)
                self._streaming = True
            case Action.REQUEST_OFFBOARD:
                commands.start(commands.enter_offboard(), Event.OFFBOARD_CONFIRMED, Event.OFFBOARD_REFUSED)
            case Action.STREAM_STOP:
                self._streaming = False
                self._sar.abandon()
                commands.cancel()
            case Action.LEAVE_TO_HOLD:
                commands.start(commands.hold())
            case Action.LAND:
                commands.start(commands.land())
            case Action.LEAVE_ON_THE_GROUND:
                commands.start(commands.leave_on_the_ground())
            case Action.LEAVE_AT_TARGET:
                leave = {"hold": commands.hold, "land": commands.land, "return": commands.return_home}
                commands.start(leave[config.leave]())
            case Action.LEAVE_WITHOUT_TARGET:
                commands.start(commands.return_home() if config.lost_target == "return" else commands.land())

    def _send_setpoint(self, vehicle: VehicleState, now_ns: int) -> None:
        moving = self.state in (State.ACQUIRING, State.APPROACHING)
        if moving:
            self._sar.begin()
            self._sar.slide(now_ns)
        else:
            self._sar.abandon()
        setpoint = self._approach.setpoint(now_ns, self.knowledge.aim(vehicle), moving)
        if self._config.mission.setpoints == "velocity" and vehicle.p_local_enu_m is not None:
            setpoint = as_velocity(setpoint, vehicle.p_local_enu_m, self._gate.limits)
        ours = self.state is State.TAKING_OFF or vehicle.mode is FlightMode.OFFBOARD
        verdict = self._gate.check(setpoint, vehicle, now_ns, ours, self._targets.places(), self._frame.ground_m)
        is_new = not self._refusals or self._age_s(self._refused_ns) >= _REFUSED_AGAIN_S
        if verdict.reasons and is_new and not self._frame.is_stepping(now_ns):
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
        self._stream_ns = setpoint.t_mono_ns
        self._recorder.record(SETPOINT, setpoint.t_mono_ns, setpoint)

    def _give_up_leg(self, reasons: tuple[Reason, ...], vehicle: VehicleState) -> None:
        """The path has left what the gate allows, and the gate's hold only follows the vehicle. So the next leg begins,
        and the vehicle stands, where it is; in the fence's way, inside it. A path that cannot be flown is a blind leg:
        after enough of them the mission holds, and then leaves."""
        self._course.explain(f"gate: {'; '.join(reasons)}")
        _log.warning(self._course.reason)
        self.knowledge.note_blind_leg()
        self._sar.abandon()
        if (p_m := vehicle.p_local_enu_m) is None:
            return
        self._begin_path(inside(p_m, self._gate.limits), vehicle)

    def _begin_path(self, p_m: Vector3, vehicle: VehicleState) -> None:
        v_m_s = vehicle.v_local_enu_m_s or (0.0, 0.0, 0.0)
        self._approach.start(p_m, vehicle.yaw_enu_rad or 0.0, self._frame.ground_m, v_m_s)

    def _follow_frame(self, vehicle: VehicleState, now_ns: int) -> None:
        """Where the vehicle set its local frame anew, all that is noted in it moves along; nothing else does."""
        delta_m = self._frame.follow(vehicle, now_ns)
        if delta_m is not None:
            _log.warning("the vehicle set its position anew by %.2f, %.2f, %.2f m; the path moves along", *delta_m)
            self._approach.shift(delta_m)
            self.knowledge.targets.shift(delta_m)
            self._sar.abandon()

    def _observe(self, vehicle: VehicleState, now_ns: int) -> None:
        self._sar.begin()
        self._sar.slide(now_ns)
        target, p_m, frame = self._targets.target, vehicle.p_local_enu_m, self._frame
        if target is not None and p_m is not None:
            height_m = frame.ground_m + self._config.mission.takeoff_height_m
            wanted = would_be_setpoint(now_ns, p_m, target.azimuth_rad, self._config.mission, height_m)
            verdict = self._gate.check(wanted, vehicle, now_ns, True, self._targets.places(), frame.ground_m)
            self._recorder.record(OBSERVED, now_ns, ObservedSetpoint(now_ns, wanted, verdict.reasons))

    def _report(self, event: Event | None, reason: str) -> None:
        """What a command ended in, and why it failed."""
        with self._clock.event() as now_ns:
            self._recorder.record(COMMAND, now_ns, CommandOutcome(now_ns, event, reason))
            self._course.report(event, reason)

    def _age_s(self, t_ns: int | None) -> float:
        return age_s(t_ns, self._clock.now_ns())
