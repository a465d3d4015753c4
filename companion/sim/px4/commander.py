"""The mock's commander: which mode flies, arming, failsafe, and what each mode asks of the airframe. No I/O, no clock.

PX4 keeps what the user asked for (`intention`) apart from what flies (`mode`). A lost set point stream makes a
failsafe mode fly while the intention stays OFFBOARD, so a stream that comes back is followed again at once; that, the
two acknowledgements of a mode command and the return to OFFBOARD after disarming are the traps a companion must
survive, so they are kept here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, IntEnum

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.sim.px4.airframe import Airframe, Demand
from companion.sim.px4.estimator import PositionEstimator
from companion.sim.px4.navigator import Return, is_outside_fence, landing
from companion.sim.px4.parameters import DEFAULTS, Parameters
from companion.sim.px4.rover import RoverFrame
from companion.sim.px4.wander import Wander

_HISTORY = 200


class Mode(Enum):
    """PX4's (main mode, sub mode) of HEARTBEAT.custom_mode. DESCEND is reported as LAND by PX4 itself."""

    MANUAL = (1, 0)
    ALTCTL = (2, 0)
    POSCTL = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    RTL = (4, 5)
    LAND = (4, 6)
    OFFBOARD = (6, 0)

    @property
    def custom_mode(self) -> int:
        main, sub = self.value
        return int(main) << 16 | int(sub) << 24


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


_TRANSIENT = (Mode.TAKEOFF, Mode.LAND, Mode.RTL)
"""Modes that PX4 does not go back to after disarming."""
_LANDED_S = 7.7
"""From touching the ground until PX4 calls itself landed."""
_BRAKES_NS, _BRAKES_M_S, _CREEPS_M_S = 1_200_000_000, 0.06, 0.22
"""Seen after a takeoff to 1.5 m: where it becomes a hold the climb nearly ends, and a second later it creeps on."""
_NAVIGATOR_READS_NS = NS_PER_S
"""No oftener: a takeoff climbs to the MIS_TAKEOFF_ALT that it read last."""


@dataclass(slots=True)
class StreamCount:
    """What arrived of the set point stream."""

    received: int = 0
    in_offboard: int = 0
    last_ns: int | None = None
    largest_gap_s: float = 0.0
    """Between two set points, both within one stay in OFFBOARD."""


class Commander:
    """Modes and arming over an `Airframe`. Every method takes the present time; time never runs by itself.

    What is known of the position is the estimator's to say; it flies to places of the estimate, not of the truth.
    """

    def __init__(
        self,
        airframe: Airframe,
        now_ns: int,
        parameters: Parameters | None = None,
        drift_m: float = 0.0,
        wander: Wander | None = None,
    ) -> None:
        """`drift_m`: how far the estimate's Up wanders in the first minute on the ground; `wander`: all of it in
        flight."""
        self.airframe = airframe
        self.parameters = DEFAULTS | (parameters or {})
        self._drift_m, self._wander = drift_m, wander
        self.refuse_offboard = False
        self.failing_checks: tuple[str, ...] = ()
        """A fault to inject: names of `arming.CHECKS`."""
        self.stream = StreamCount()
        self.offboard_s = 0.0
        self.history: list[tuple[int, Mode]] = []
        self.said: list[str] = []
        """What the pilot is told; the link takes it from here."""
        self.boot(now_ns)

    def boot(self, now_ns: int) -> None:
        """Begin as after power-up: disarmed, in hold, nothing heard of a stream. Counters and parameters stay."""
        self.airframe.rest()
        self.airframe.estimate_offset_enu_m = (0.0, 0.0, 0.0)
        self.estimator = PositionEstimator(self.airframe, self.parameters, now_ns, self._drift_m, self._wander)
        self.intention = self.mode = Mode.HOLD
        self.armed = self.failsafe = False
        self.landed = self.airframe.on_ground
        self.history.append((now_ns, self.mode))
        self._now_ns = self._armed_ns = self._contact_ns = now_ns
        self._after_disarm = Mode.HOLD
        self._has_flown = self._tops_up = False
        self._fence_mode: Mode | None = None
        self._was_outside = False
        self._previous_set_point_ns: int | None = None
        self.stream.last_ns = None
        self._navigator_ns, self._takeoff_alt_m = now_ns, float(self.parameters["MIS_TAKEOFF_ALT"])
        self._climbs_m = self._takeoff_alt_m
        self._home_m = self.airframe.estimated_p_enu_m
        self._target = self._hover()
        self._return = self._new_return()

    @property
    def drives(self) -> bool:
        """Whether it is a rover."""
        return isinstance(self.airframe, RoverFrame)

    @property
    def is_at_rest(self) -> bool:
        """As the estimator takes it: motors off, on the ground."""
        return self.landed and not self.armed

    @property
    def can_arm(self) -> bool:
        runs = self.intention not in (Mode.LAND, Mode.RTL) and self._can_run(self.intention)
        return runs and not self.failing_checks

    def step(self, now_ns: int) -> None:
        """Move time on to `now_ns`."""
        dt_s = (now_ns - self._now_ns) / NS_PER_S
        self._now_ns = now_ns
        if now_ns - self._navigator_ns >= _NAVIGATOR_READS_NS:
            self._navigator_ns, self._takeoff_alt_m = now_ns, float(self.parameters["MIS_TAKEOFF_ALT"])
        self.estimator.step(now_ns, self.is_at_rest)
        self._watch_fence()
        self._choose_mode()
        if self.mode is Mode.OFFBOARD and self.armed:
            self.offboard_s += dt_s
        if self.armed:
            self.airframe.step(self._demand(), dt_s)
        else:
            self.airframe.rest()
        self._watch_takeoff()
        self._watch_ground()

    def set_point(self, demand: Demand, now_ns: int) -> None:
        """A SET_POSITION_TARGET arrived. Followed in OFFBOARD only, but it always counts as a sign of life."""
        stream, last_ns = self.stream, self.stream.last_ns
        stream.received += 1
        if self.mode is Mode.OFFBOARD:
            stream.in_offboard += 1
            self._target = demand
            if last_ns is not None and last_ns >= self.history[-1][0]:
                stream.largest_gap_s = max(stream.largest_gap_s, (now_ns - last_ns) / NS_PER_S)
        self._previous_set_point_ns, stream.last_ns = last_ns, now_ns

    def arm(self, now_ns: int) -> Result:
        if self.armed:
            return Result.ACCEPTED
        self._now_ns = max(self._now_ns, now_ns)
        if not self.can_arm:
            self.said.append("Arming denied: resolve system health failures")
            return Result.TEMPORARILY_REJECTED
        self.armed, self._armed_ns, self._has_flown = True, now_ns, False
        self._home_m = self.airframe.estimated_p_enu_m
        return Result.ACCEPTED

    def disarm(self) -> Result:
        if not self.landed:
            return Result.DENIED
        self.armed = False
        self._intend(self._after_disarm)
        return Result.ACCEPTED

    def command_mode(self, mode: Mode, now_ns: int) -> Result:
        """A companion or ground station asks for a mode: disarmed any is taken, armed one that can be flown."""
        self._now_ns = max(self._now_ns, now_ns)
        refused = self.armed and not (self._can_run(mode) and (mode is not Mode.OFFBOARD or self._streaming(now_ns)))
        if refused or (mode is Mode.OFFBOARD and self.refuse_offboard):
            return Result.TEMPORARILY_REJECTED
        self._intend(mode)
        return Result.ACCEPTED

    def command_takeoff(self, now_ns: int | None = None) -> Result:
        return self.command_mode(Mode.TAKEOFF, self._now_ns if now_ns is None else now_ns)

    def pilot_mode(self, mode: Mode) -> None:
        """A person moves the mode switch (or the sticks, with COM_RC_OVERRIDE)."""
        self._intend(mode)

    def sticks(self, v_enu_m_s: Vector3) -> None:
        """A person flies: arms where that is needed, and in position mode moves the vehicle with this velocity."""
        self.arm(self._now_ns)
        self._intend(Mode.POSCTL)
        if v_enu_m_s[2] > 0:
            self.landed, self._contact_ns = False, self._now_ns
        self._target = Demand((None, None, None), v_enu_m_s)

    def _intend(self, mode: Mode) -> None:
        self.intention, self._fence_mode = mode, None
        if mode not in _TRANSIENT:
            self._after_disarm = mode
        self._choose_mode()

    def _can_run(self, mode: Mode) -> bool:
        if mode in (Mode.HOLD, Mode.RTL):
            return self.estimator.has_global_position
        if mode is Mode.TAKEOFF and self.drives:
            return False
        if mode in (Mode.TAKEOFF, Mode.POSCTL):
            return self.estimator.has_local_position
        return mode is not Mode.OFFBOARD or (self.estimator.has_local_position and self._signal(self._now_ns))

    def _choose_mode(self) -> None:
        runs = self._can_run(self.intention)
        self.failsafe = self.armed and (not runs or self._fence_mode is not None)
        mode = self.intention
        if self.failsafe:
            mode = self._flyable((self._fence_mode or Mode.HOLD) if runs else self._fallback())
        if mode is self.mode:
            return
        was_climbing = self.mode is Mode.TAKEOFF and not self.failsafe
        self.mode = mode
        if mode is Mode.TAKEOFF:
            self._climbs_m = self._takeoff_alt_m
        self.history[:] = [*self.history[1 - _HISTORY :], (self._now_ns, mode)]
        # A takeoff that has come near its height goes on to it in hold.
        self._tops_up = was_climbing and self._is_near_takeoff_height()
        self._target = self._takeoff_point() if self._tops_up else self._hover()
        self._return = self._new_return()

    def _fallback(self) -> Mode:
        if self.intention is not Mode.OFFBOARD:
            return Mode.RTL
        # 0..2 ask for a mode that needs a pilot's sticks; without RC PX4 descends, which it reports as LAND.
        return {3: Mode.RTL, 4: Mode.LAND, 5: Mode.HOLD}.get(int(self.parameters["COM_OBL_RC_ACT"]), Mode.LAND)

    def _flyable(self, mode: Mode) -> Mode:
        """Hold and return need a global position; without one PX4 lands, and without any it descends blind."""
        return mode if self._can_run(mode) else Mode.LAND

    def _signal(self, now_ns: int) -> bool:
        last_ns = self.stream.last_ns
        return last_ns is not None and now_ns - last_ns < self.parameters["COM_OF_LOSS_T"] * NS_PER_S

    def _streaming(self, now_ns: int) -> bool:
        """More than 2 Hz: the newest two set points, and now, each less than half a second apart."""
        last_ns, before_ns = self.stream.last_ns, self._previous_set_point_ns
        if last_ns is None or before_ns is None:
            return False
        return max(now_ns - last_ns, last_ns - before_ns) < NS_PER_S // 2

    def _hover(self) -> Demand:
        return Demand(self.airframe.stopping_point_enu_m(), (0.0, 0.0, 0.0))

    def _takeoff_point(self) -> Demand:
        x, y, _ = self._target.p_enu_m
        return Demand((x, y, self._home_m[2] + self._climbs_m), (0.0, 0.0, 0.0))

    def _new_return(self) -> Return:
        return Return(self.airframe.estimated_p_enu_m, self._home_m, self.parameters)

    def _demand(self) -> Demand:
        if self.drives and self.mode in (Mode.LAND, Mode.RTL):
            x, y, _ = self._home_m if self.mode is Mode.RTL else self._target.p_enu_m
            return Demand((x, y, None), (0.0, 0.0, 0.0))
        here_m, slow_m_s = self.airframe.estimated_p_enu_m, float(self.parameters["MPC_LAND_SPEED"])
        if self.mode is Mode.TAKEOFF:
            return self._climb(here_m, float(self.parameters["MPC_TKO_SPEED"]))
        if self.mode is Mode.LAND:
            place = self._target.p_enu_m[:2] if self.estimator.has_local_position else (None, None)
            return landing(here_m, self._home_m, place, slow_m_s)
        if self.mode is Mode.RTL:
            return self._return.demand(here_m)
        if self.landed and self.mode is not Mode.OFFBOARD:
            return Demand((*self._target.p_enu_m[:2], None), (0.0, 0.0, 0.0))
        if self.mode is Mode.HOLD and self._tops_up:
            has_braked = self._now_ns - self.history[-1][0] > _BRAKES_NS
            return self._climb(here_m, _CREEPS_M_S if has_braked else _BRAKES_M_S)
        return self._target

    def _climb(self, here_m: Vector3, climb_m_s: float) -> Demand:
        x, y, z = self._takeoff_point().p_enu_m
        assert z is not None
        if z - here_m[2] < climb_m_s:
            return Demand((x, y, z), (0.0, 0.0, 0.0))
        return Demand((x, y, None), (0.0, 0.0, climb_m_s))

    def _is_near_takeoff_height(self) -> bool:
        left_m = self._home_m[2] + self._climbs_m - self.airframe.estimated_p_enu_m[2]
        return not self.airframe.on_ground and left_m < self.parameters["NAV_MC_ALT_RAD"]

    def _watch_takeoff(self) -> None:
        """PX4 ends a takeoff within NAV_MC_ALT_RAD of its height, if it can hold; else it stays in takeoff."""
        if self.armed and self.mode is Mode.TAKEOFF and self._is_near_takeoff_height() and self._can_run(Mode.HOLD):
            self._intend(Mode.HOLD)

    def _watch_fence(self) -> None:
        outside = self.armed and is_outside_fence(self.airframe.estimated_p_enu_m, self._home_m, self.parameters)
        if outside and not self._was_outside:
            action = {2: Mode.HOLD, 3: Mode.RTL, 5: Mode.LAND}
            self._fence_mode = action.get(int(self.parameters["GF_ACTION"]))
        self._was_outside = outside

    def _watch_ground(self) -> None:
        if self.drives:
            self._watch_rover()
            return
        if not self.airframe.on_ground:
            self._contact_ns = self._now_ns
            self.landed, self._has_flown = False, True
            return
        contact_s = (self._now_ns - max(self._contact_ns, self._armed_ns)) / NS_PER_S
        self.landed = self.landed or contact_s > _LANDED_S
        wait_s = self.parameters["COM_DISARM_PRFLT"]
        if self._has_flown:
            wait_s = _LANDED_S + self.parameters["COM_DISARM_LAND"]
        if self.armed and self.landed and contact_s > wait_s:
            self.disarm()

    def _watch_rover(self) -> None:
        """PX4's RoverLandDetector: while it is armed a rover has not landed, but in land, and at home in return."""
        here_m = self.airframe.estimated_p_enu_m
        is_home = self.mode is Mode.RTL and math.dist(here_m[:2], self._home_m[:2]) < self.parameters["NAV_ACC_RAD"]
        self.landed = not self.armed or self.mode is Mode.LAND or is_home
        if not self.landed:
            self._contact_ns = self._now_ns
        elif self.armed and self._now_ns - self._contact_ns > self.parameters["COM_DISARM_LAND"] * NS_PER_S:
            self.disarm()


def finite_or_none(
    values: Vector3, ignored: tuple[bool, bool, bool]
) -> tuple[float | None, float | None, float | None]:
    """Components that the type mask ignores or that are not numbers become None."""
    x, y, z = (None if skip or not math.isfinite(v) else v for v, skip in zip(values, ignored, strict=True))
    return (x, y, z)
