"""What the mission's conditions look at, gathered at every tick, and what only the flight itself knows of it."""

from __future__ import annotations

from companion.core.clock import NS_PER_S, age_s
from companion.core.messages import FlightMode, VehicleState
from companion.flight.course import Course
from companion.flight.knowledge import Knowledge
from companion.mission.conditions import Situation
from companion.mission.table import State
from companion.pose.intake import PoseIntake


class Situations:
    """One for each tick: `see` the vehicle, take `now`, and `end_tick`."""

    def __init__(self, course: Course, intake: PoseIntake, knowledge: Knowledge) -> None:
        self._course = course
        self._intake = intake
        self._knowledge = knowledge
        self._took_off = False
        self._stood_still_ns = 0
        """What the vehicle had told of our clock when it was engaged,"""
        self._boots = self._offboard_left = 0
        """of its restarts and of leaving OFFBOARD."""
        self._battery_known_ns = 0
        """When all batteries told their charge last."""
        self._stream_ns: int | None = None
        """When the newest set point of the stream went out, or the stream began; in preflight the last tick, since what
        it looked at grows old; else None."""

    @property
    def is_taking_off(self) -> bool:
        """Whether the vehicle has followed the command to take off."""
        return self._took_off and self._course.state is State.TAKING_OFF

    def begin_anew(self, vehicle: VehicleState) -> None:
        """An engagement begins."""
        self._took_off, self._stood_still_ns = vehicle.in_air, vehicle.stood_still_ns
        self._boots, self._offboard_left = vehicle.boots, vehicle.offboard_left

    def see(self, vehicle: VehicleState) -> None:
        taking_off = self._course.state is State.TAKING_OFF
        self._took_off |= taking_off and (vehicle.in_air or vehicle.mode is FlightMode.TAKEOFF)
        if vehicle.battery_remaining is not None and not vehicle.batteries_unknown:
            self._battery_known_ns = vehicle.t_mono_ns

    def note_sent(self, t_ns: int) -> None:
        """A set point has gone out."""
        self._stream_ns = t_ns

    def end_tick(self, now_ns: int, streaming: bool) -> None:
        if streaming:
            self._stream_ns = self._stream_ns or now_ns
        else:
            self._stream_ns = now_ns if self._course.state is State.PREFLIGHT else None

    def now(self, vehicle: VehicleState, now_ns: int, slept_s: float) -> Situation:
        """The host was suspended for `slept_s` since the tick before."""
        p_m, knowledge = vehicle.p_local_enu_m, self._knowledge
        return Situation(
            vehicle=vehicle,
            now_ns=now_ns,
            in_state_s=age_s(self._course.since_ns, now_ns),
            took_off=self._took_off,
            pose_age_s=self._intake.age_s(),
            pose_failed=self._intake.is_lost(),
            target_age_s=knowledge.age_s(),
            blind_legs=knowledge.blind_legs,
            tries=knowledge.tries,
            stream_gap_s=0.0 if self._stream_ns is None else (now_ns - self._stream_ns) / NS_PER_S,
            stood_still_s=(vehicle.stood_still_ns - self._stood_still_ns) / NS_PER_S,
            slept_s=slept_s,
            restarted=vehicle.boots != self._boots,
            left_offboard=vehicle.offboard_left != self._offboard_left,
            battery_unknown_s=(now_ns - self._battery_known_ns) / NS_PER_S,
            target_near=p_m is not None and knowledge.is_near(p_m),
        )
