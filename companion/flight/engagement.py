"""Whether the vehicle may be engaged: gathers what `preflight` judges."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from companion.autopilot.port import Autopilot, AutopilotError
from companion.config.schema import Config
from companion.core.clock import age_s
from companion.core.event_clock import EventClock
from companion.core.inputs import Event, Surroundings
from companion.core.messages import VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import SURROUNDINGS
from companion.flight.course import Course
from companion.flight.knowledge import Knowledge
from companion.flight.limits import gate_limits
from companion.flight.status import vehicle_name
from companion.neighbours.neighbour import Neighbour
from companion.pose.intake import PoseIntake
from companion.safety.preflight import (
    EXPECTED,
    RETURN,
    Heights,
    Readiness,
    ReadinessLimits,
    parameter_problems,
    readiness_problems,
    required_parameters,
    return_problems,
    target_problems,
)
from companion.sensing.iterations import SarIterations

_CHECKED_FOR_S = 30.0
"""How long a look at the autopilot's parameters stands for them."""
_POSITION_S = 1.0


class Engagement:
    """Looks at every part of the service and at the autopilot; commands nothing."""

    def __init__(
        self,
        *,
        config: Config,
        clock: EventClock,
        intake: PoseIntake,
        knowledge: Knowledge,
        autopilot: Autopilot,
        sar: SarIterations,
        recorder: Recorder,
        look: Callable[[], Surroundings] | None = None,
        network_problem: Callable[[], str] = str,
    ) -> None:
        assert config.autopilot is not None
        self._config = config
        self._gps = config.autopilot.gps
        self._vehicle = config.mission.vehicle
        self._forwards = config.autopilot.forward_vio_hz > 0
        self._fence = gate_limits(config)
        self._heights = Heights(config.mission.takeoff_height_m, config.gate.fence_max_m[2])
        self._clock = clock
        self._network_problem = network_problem
        self._look = look or self._look_around
        self._seen: tuple[int, Surroundings] | None = None
        self._intake = intake
        self._knowledge = knowledge
        self._autopilot = autopilot
        self._sar = sar
        self._recorder = recorder
        self._checked_ns: int | None = None
        self._limits = ReadinessLimits(
            silent_s=config.aperture.silent_s,
            min_battery=config.mission.min_battery,
            min_free_mib=config.recorder.min_free_mib,
        )

    @property
    def vehicle(self) -> str:
        """Which one would be engaged."""
        return vehicle_name(self._autopilot.state())

    def not_ready(self, target: Neighbour | None = None) -> list[str]:
        """What is missing now, in words, but for the autopilot's parameters, which must be asked for. For a flight to
        `target`; without one to the robot that is the target already."""
        return readiness_problems(self._readiness(target or self._knowledge.neighbour), self._limits)

    def not_heard(self, target: Neighbour) -> list[str]:
        """What is missing of a robot, in words, while the vehicle flies."""
        return target_problems(self._readiness(target), self._limits)

    def check_again(self, course: Course) -> None:
        """The tick's own look at what `engage` has looked at, a moment later and with the parameters it has read."""
        missing = self.not_ready()
        if not self._surroundings().parameters_checked:
            missing.append("the autopilot's parameters were not checked")
        course.explain("; ".join(missing))
        course.report(Event.PREFLIGHT_FAILED if missing else Event.PREFLIGHT_PASSED)

    async def parameter_problems(self) -> list[str]:
        """Reads what is required of the autopilot, all at once; one line for each that is wrong."""
        self._checked_ns = None
        if self._autopilot.problem:
            return ["the autopilot's parameters were not read"]
        names = [requirement.name for requirement in required_parameters(self._gps, self._vehicle)]
        values = await self._read_all(names)
        problems = list(parameter_problems(values, self._gps, self._heights, self._vehicle))
        self._checked_ns = None if problems else self._clock.now_ns()
        return problems

    async def return_problems(self) -> list[str]:
        """Reads what a return climbs by anew; one line for each that is wrong. A rover does not climb."""
        if self._vehicle != "copter":
            return []
        return list(return_problems(await self._read_all(RETURN), self._heights))

    async def _read_all(self, names: Sequence[str]) -> dict[str, float | str]:
        return dict(zip(names, await asyncio.gather(*map(self._read, names)), strict=True))

    async def _read(self, name: str) -> float | str:
        try:
            return await self._autopilot.parameter(name)
        except AutopilotError as error:
            return str(error)

    def _readiness(self, target: Neighbour) -> Readiness:
        vehicle, around = self._autopilot.state(), self._surroundings()
        is_aimed_at = target is self._knowledge.neighbour
        return Readiness(
            observes=self._config.mission.control == "observe",
            autopilot_problem=around.autopilot_problem,
            heartbeat_age_s=self._age_s(vehicle.heartbeat_mono_ns),
            has_position=vehicle.p_local_enu_m is not None and self._age_s(vehicle.position_mono_ns) < _POSITION_S,
            has_heading=vehicle.yaw_enu_rad is not None,
            estimator_age_s=self._age_s(vehicle.estimator_mono_ns),
            estimator_healthy=vehicle.estimator_healthy,
            position_is_global=vehicle.position_is_global,
            outside_fence=self._outside(vehicle),
            failsafe=vehicle.failsafe,
            mode=vehicle.mode,
            intended_mode=vehicle.intended_mode,
            in_air=vehicle.in_air,
            landed_unknown=vehicle.landed_unknown,
            are_two=vehicle.are_two,
            armed=vehicle.armed,
            can_arm=vehicle.can_arm,
            arming_reasons=vehicle.arming_reasons,
            vehicle=self._vehicle,
            not_px4="" if vehicle.autopilot in ("", EXPECTED[self._vehicle]) else vehicle.autopilot,
            timesync_age_s=self._age_s(vehicle.timesync_mono_ns),
            time_known=vehicle.clock_offset_ns is not None or not self._forwards,
            battery=vehicle.battery_remaining,
            batteries_unknown=vehicle.batteries_unknown,
            pose_problem=self._intake.problem(),
            north_problem=self._intake.north_problem(),
            datagram_age_s=self._knowledge.datagram_age_s(target.id),
            packet_age_s=self._knowledge.packet_age_s(target.id),
            bad_signatures=around.bad_signatures if is_aimed_at else target.refused.bad_key,
            old_boots=target.session.old_boots,
            clock_problem=target.not_locked(self._clock.now_ns()),
            aoa_ready=self._sar.is_ready,
            recorder_failed=around.recorder_failed,
            free_mib=around.free_mib,
            network_problem=around.network_problem,
        )

    def _outside(self, vehicle: VehicleState) -> str:
        p_m = vehicle.p_local_enu_m
        if p_m is None or (self._fence.is_in_box(p_m) and self._fence.is_in_cylinder(p_m)):
            return ""
        return "East {:.1f}, North {:.1f}, Up {:.1f} m".format(*p_m)

    def _surroundings(self) -> Surroundings:
        """The same for all of one event, and recorded with it."""
        if not self._clock.is_held:
            return self._look()
        if self._seen is None or self._seen[0] != self._clock.number:
            self._seen = self._clock.number, self._look()
            self._recorder.record(SURROUNDINGS, self._clock.now_ns(), self._seen[1])
        return self._seen[1]

    def _look_around(self) -> Surroundings:
        return Surroundings(
            t_mono_ns=self._clock.now_ns(),
            autopilot_problem=self._autopilot.problem,
            parameters_checked=self._age_s(self._checked_ns) < _CHECKED_FOR_S,
            bad_signatures=self._knowledge.neighbour.refused.bad_key,
            recorder_failed=self._recorder.failed,
            free_mib=_free_mib(self._config.path(self._config.recorder.path).parent),
            network_problem=self._network_problem(),
        )

    def _age_s(self, t_ns: int | None) -> float:
        return age_s(t_ns, self._clock.now_ns())


def _free_mib(directory: Path) -> float:
    """Nothing is free where the log's directory has gone."""
    try:
        return shutil.disk_usage(directory).free / (1 << 20)
    except OSError:
        return 0.0
