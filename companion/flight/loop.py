"""The flying robot's 20 Hz loop: all that may command the vehicle; conditions, mission, actions, set point, gate."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

from companion.autopilot.port import Autopilot, AutopilotError
from companion.autopilot.silent import SilentAutopilot
from companion.config.schema import Config
from companion.core.clock import HostSleep, Ticker, age_s
from companion.core.event_clock import EventClock
from companion.core.inputs import CommandOutcome, Event, Surroundings, Tick
from companion.core.messages import FlightMode, Setpoint, Vector3, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import COMMAND, END, SETPOINT, TICK
from companion.flight.commands import Command, FlightCommands, MakeCommands
from companion.flight.course import Course
from companion.flight.engagement import Engagement
from companion.flight.knowledge import Knowledge
from companion.flight.limits import condition_limits, gate_limits
from companion.flight.local_frame import LocalFrame
from companion.flight.observer import Observer
from companion.flight.origin import Origin
from companion.flight.rc_switch import configured_switch
from companion.flight.refusals import GateRefusals
from companion.flight.situation import Situations
from companion.flight.status import status
from companion.flight.vehicle_feed import VehicleFeed
from companion.flight.wishes import Wishes
from companion.guidance.approach import Approach, as_velocity, inside
from companion.guidance.ground import in_plane
from companion.mission.conditions import SLEPT_S, conditions
from companion.mission.table import AT_REST, Action, State
from companion.neighbours.neighbour import Neighbour
from companion.pose.intake import PoseIntake
from companion.safety.gate import Gate, Reason
from companion.sensing.iterations import SarIterations

_log = logging.getLogger(__name__)
_RATE_HZ = 20.0


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
        chooses_motion: bool = True,
    ) -> None:
        """A replay runs no commands and gives a `look` of its own at what was around. The way to the target is
        chosen by what it would tell (`companion.guidance.choice`); without `chooses_motion` by a rule, to compare."""
        assert config.autopilot is not None
        self._config = config
        self._clock = clock
        self._observes = config.mission.control == "observe"
        self._autopilot: Autopilot = SilentAutopilot(autopilot) if self._observes else autopilot
        self._sar = sar
        self._recorder = recorder
        self._gate = Gate(gate_limits(config))
        self._approach = Approach(config.mission, self._gate.limits, config.aperture.length_m)
        self._limits = condition_limits(config)
        self._ticker = Ticker(clock, _RATE_HZ)
        self._sleep = HostSleep()
        self._commands = make_commands(self._autopilot, clock, self._report)
        self._course = Course(clock, recorder)
        self._frame = LocalFrame()
        self.knowledge = Knowledge(
            config=config,
            clock=clock,
            recorder=recorder,
            neighbours=neighbours,
            sar=sar,
            course=self._course,
            frame=self._frame,
            chooses_motion=chooses_motion,
        )
        self._targets = self.knowledge.targets
        self._engagement = Engagement(
            config=config,
            clock=clock,
            intake=intake,
            knowledge=self.knowledge,
            autopilot=self._autopilot,
            sar=sar,
            recorder=recorder,
            look=look,
            network_problem=network_problem,
        )
        switch = configured_switch(config.autopilot)
        self.wishes = Wishes(
            clock=clock,
            recorder=recorder,
            course=self._course,
            engagement=self._engagement,
            knowledge=self.knowledge,
            switch=switch,
            beside=self._commands.beside,
        )
        self._feed = VehicleFeed(self._autopilot, sar, intake, recorder)
        self._origin = Origin(self._autopilot, config.autopilot)
        self._situations = Situations(self._course, intake, self.knowledge)
        self._observer = Observer(
            mission=config.mission, gate=self._gate, targets=self._targets, frame=self._frame, recorder=recorder
        )
        self._refusals = GateRefusals(recorder)
        self._streaming = False
        self._tick_ns: int | None = None

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
        return age_s(self._tick_ns, self._clock.now_ns()) < 1.0

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
            flying = self._streaming or self._situations.is_taking_off
            self._streaming = False
            self._course.end(now_ns)
            return flying

    def _turn(self, now_ns: int, slept_s: float) -> None:
        self._tick_ns = now_ns
        vehicle = self._feed.take(now_ns)
        self._follow_frame(vehicle, now_ns)
        self.knowledge.follow(vehicle)
        self._origin.tick(vehicle, now_ns)
        self._situations.see(vehicle)
        self.wishes.watch_switch(vehicle)
        situation = self._situations.now(vehicle, now_ns, slept_s)
        worst = self._course.worst(conditions(self.state, situation, self._limits))
        if worst is not None:
            self._step(worst, vehicle, now_ns)
        if self._streaming:
            self._send_setpoint(vehicle, now_ns)
        elif self._observes:
            self._measure(now_ns, True)
            self._observer.note(vehicle, now_ns)
        self._situations.end_tick(now_ns, self._streaming)

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
                self._situations.begin_anew(vehicle)
                self.knowledge.begin_anew()
                self._engagement.check_again(self._course)
            case Action.ARM_AND_TAKE_OFF:
                drives = config.vehicle == "rover"
                begin = commands.arm() if drives else commands.take_off(config.takeoff_height_m)
                commands.start(begin, Event.AIRBORNE, Event.TAKEOFF_FAILED)
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
                leave = {"hold": commands.hold, "land": commands.land, "return": self._return_home}
                commands.start(leave[config.leave]())
            case Action.LEAVE_WITHOUT_TARGET:
                commands.start(self._return_home() if config.lost_target == "return" else commands.land())

    def _return_home(self) -> Command:
        return self._commands.return_home(self._engagement.return_problems)

    def _send_setpoint(self, vehicle: VehicleState, now_ns: int) -> None:
        moving = self.state in (State.ACQUIRING, State.APPROACHING)
        self._measure(now_ns, moving)
        setpoint = self._approach.setpoint(now_ns, self.knowledge.aim(vehicle), moving, self.knowledge.others())
        mission, p_m = self._config.mission, vehicle.p_local_enu_m
        if mission.vehicle == "rover" and p_m is not None:
            setpoint = in_plane(setpoint, p_m, self._gate.limits)
        elif mission.setpoints == "velocity" and p_m is not None:
            setpoint = as_velocity(setpoint, p_m, self._gate.limits)
        ours = self.state is State.TAKING_OFF or vehicle.mode is FlightMode.OFFBOARD
        verdict = self._gate.check(
            setpoint, vehicle, now_ns, ours, neighbours=self.knowledge.places(), ground_m=self._frame.ground_m
        )
        if self._refusals.note(verdict.reasons, now_ns, self._frame.is_stepping(now_ns)):
            self._give_up_leg(verdict.reasons, vehicle)
        if verdict.setpoint is not None:
            self._send(verdict.setpoint)

    def _measure(self, now_ns: int, moving: bool) -> None:
        """Apertures are cut from a path that is flown, not from a stand."""
        if moving:
            self._sar.begin()
            self._sar.slide(now_ns)
        else:
            self._sar.abandon()

    def _send(self, setpoint: Setpoint) -> None:
        try:
            self._autopilot.send_setpoint(setpoint)
        except AutopilotError as error:
            self._report(Event.LINK_LOST, str(error))
            return
        self._situations.note_sent(setpoint.t_mono_ns)
        self._recorder.record(SETPOINT, setpoint.t_mono_ns, setpoint)

    def _give_up_leg(self, reasons: tuple[Reason, ...], vehicle: VehicleState) -> None:
        """The path has left what the gate allows, and the gate's hold only follows the vehicle. So the next leg begins,
        and the vehicle stands, where it is; in the fence's way, inside it. A path that cannot be flown is a blind leg:
        after enough of them the mission holds, and then leaves."""
        self._course.explain(f"gate: {'; '.join(reasons)}")
        _log.warning(self._course.reason)
        self.knowledge.note_blind_leg()
        self._sar.abandon()
        if vehicle.p_local_enu_m is not None:
            here_m = inside(vehicle.p_local_enu_m, self._gate.limits, self._frame.ground_m)
            self._begin_path(here_m, vehicle)

    def _begin_path(self, p_m: Vector3, vehicle: VehicleState) -> None:
        v_m_s = vehicle.v_local_enu_m_s or (0.0, 0.0, 0.0)
        self._approach.start(p_m, vehicle.yaw_enu_rad or 0.0, self._frame.ground_m, v_m_s)

    def _follow_frame(self, vehicle: VehicleState, now_ns: int) -> None:
        """Where the vehicle set its local frame anew, all that is noted in it moves along; nothing else does."""
        delta_m = self._frame.follow(vehicle, now_ns)
        if delta_m is not None:
            _log.warning("the vehicle set its position anew by %.2f, %.2f, %.2f m; the path moves along", *delta_m)
            self._approach.shift(delta_m)
            self.knowledge.shift(delta_m)
            self._sar.shift(delta_m)

    def _report(self, event: Event | None, reason: str) -> None:
        """What a command ended in, and why it failed."""
        with self._clock.event() as now_ns:
            self._recorder.record(COMMAND, now_ns, CommandOutcome(now_ns, event, reason))
            self._course.report(event, reason)
