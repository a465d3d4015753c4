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

from companion.core.messages import Vector3
from companion.sim.px4.airframe import Airframe, Demand

NS_PER_S = 1_000_000_000
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

DEFAULT_PARAMETERS: dict[str, int | float] = {
    "COM_OF_LOSS_T": 1.0,
    "COM_OBL_RC_ACT": 0,
    "COM_RC_OVERRIDE": 1,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "EKF2_EV_CTRL": 0,
    "EKF2_GPS_CTRL": 7,
    "EKF2_HGT_REF": 1,
    "GF_ACTION": 2,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_LAND_SPEED": 0.7,
    "MPC_TKO_SPEED": 1.5,
    "SYS_HAS_GPS": 1,
}
"""PX4's own defaults; an int is an INT32 parameter."""


@dataclass(slots=True)
class StreamCount:
    """What arrived of the set point stream."""

    received: int = 0
    in_offboard: int = 0
    last_ns: int | None = None
    largest_gap_s: float = 0.0
    """Between two set points, both within one stay in OFFBOARD."""


class Commander:
    """Modes and arming over an `Airframe`. Every method takes the present time; time never runs by itself."""

    def __init__(self, airframe: Airframe, now_ns: int, parameters: dict[str, int | float] | None = None) -> None:
        self.airframe = airframe
        self.parameters = DEFAULT_PARAMETERS | (parameters or {})
        self.intention = self.mode = Mode.HOLD
        self.armed = self.failsafe = False
        self.landed = True
        self.refuse_offboard = False
        self.stream = StreamCount()
        self.offboard_s = 0.0
        self.history: list[tuple[int, Mode]] = [(now_ns, self.mode)]
        self._now_ns = self._armed_ns = self._contact_ns = now_ns
        self._after_disarm = Mode.HOLD
        self._has_flown = False
        self._previous_set_point_ns: int | None = None
        self._target = self._hover()

    def step(self, now_ns: int) -> None:
        """Move time on to `now_ns`."""
        dt_s = (now_ns - self._now_ns) / NS_PER_S
        self._now_ns = now_ns
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
        if self.intention in (Mode.LAND, Mode.RTL) or (self.intention is Mode.OFFBOARD and not self._signal(now_ns)):
            return Result.TEMPORARILY_REJECTED
        self.armed, self._armed_ns, self._has_flown = True, now_ns, False
        return Result.ACCEPTED

    def disarm(self) -> Result:
        if not self.landed:
            return Result.DENIED
        self.armed = False
        self._intend(self._after_disarm)
        return Result.ACCEPTED

    def command_mode(self, mode: Mode, now_ns: int) -> Result:
        """A companion or ground station asks for a mode."""
        if mode is Mode.OFFBOARD and (self.refuse_offboard or not self._streaming(now_ns)):
            return Result.TEMPORARILY_REJECTED
        self._intend(mode)
        return Result.ACCEPTED

    def command_takeoff(self) -> Result:
        self._intend(Mode.TAKEOFF)
        return Result.ACCEPTED

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
        self.intention = mode
        if mode not in _TRANSIENT:
            self._after_disarm = mode
        self._choose_mode()

    def _choose_mode(self) -> None:
        self.failsafe = self.armed and self.intention is Mode.OFFBOARD and not self._signal(self._now_ns)
        mode = self._fallback() if self.failsafe else self.intention
        if mode is not self.mode:
            self.mode = mode
            self.history = [*self.history[1 - _HISTORY :], (self._now_ns, mode)]
            self._target = self._hover()

    def _fallback(self) -> Mode:
        # 0..2 ask for a mode that needs a pilot's sticks; without RC PX4 descends, which it reports as LAND.
        return {3: Mode.RTL, 4: Mode.LAND, 5: Mode.HOLD}.get(int(self.parameters["COM_OBL_RC_ACT"]), Mode.LAND)

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

    def _demand(self) -> Demand:
        if self.mode is Mode.TAKEOFF:
            return self._vertical(float(self.parameters["MPC_TKO_SPEED"]))
        if self.mode is Mode.RTL and self._is_home():
            return Demand((0.0, 0.0, None), (0.0, 0.0, -float(self.parameters["MPC_LAND_SPEED"])))
        if self.mode is Mode.LAND:
            return self._vertical(-float(self.parameters["MPC_LAND_SPEED"]))
        if self.mode is Mode.RTL:
            return Demand((0.0, 0.0, self._target.p_enu_m[2]), (0.0, 0.0, 0.0))
        if self.landed and self.mode is not Mode.OFFBOARD:
            return self._vertical(0.0)
        return self._target

    def _vertical(self, climb_m_s: float) -> Demand:
        x, y, _ = self._target.p_enu_m
        return Demand((x, y, None), (0.0, 0.0, climb_m_s))

    def _is_home(self) -> bool:
        x, y, _ = self.airframe.p_enu_m
        return math.hypot(x, y) < 0.5

    def _watch_takeoff(self) -> None:
        reached = self.airframe.estimated_p_enu_m[2] > self.parameters["MIS_TAKEOFF_ALT"] - 0.1
        if self.armed and self.mode is Mode.TAKEOFF and reached:
            self._intend(Mode.HOLD)

    def _watch_ground(self) -> None:
        if not self.airframe.on_ground:
            self._contact_ns = self._now_ns
            self.landed, self._has_flown = False, True
            return
        contact_s = (self._now_ns - max(self._contact_ns, self._armed_ns)) / NS_PER_S
        self.landed = self.landed or contact_s > 0.7
        wait = "COM_DISARM_LAND" if self._has_flown else "COM_DISARM_PRFLT"
        if self.armed and self.landed and contact_s > self.parameters[wait]:
            self.disarm()


def finite_or_none(
    values: Vector3, ignored: tuple[bool, bool, bool]
) -> tuple[float | None, float | None, float | None]:
    """Components that the type mask ignores or that are not numbers become None."""
    x, y, z = (None if skip or not math.isfinite(v) else v for v, skip in zip(values, ignored, strict=True))
    return (x, y, z)
