"""Whether a takeoff has ended where it should. Pure.

PX4 goes from TAKEOFF to HOLD by itself once it is within NAV_MC_ALT_RAD of the height (0.8 m by default), brakes there,
and climbs on to the height in HOLD. So a HOLD that begins further down is a person's or a failsafe's, and so is one
that stays far below the height.
"""

from __future__ import annotations

import math
from typing import Final

from companion.autopilot.port import GaveWayError
from companion.core.messages import FlightMode, VehicleState

_SHARE: Final = 0.7
_MARGIN_M: Final = 0.3
"""By which the height may be misjudged: the estimate's Up wanders on the ground."""
_STILL_M: Final = 0.15
_STILL_NS: Final = 1_000_000_000
"""It rests when its height has stayed so near for so long. Its climb rate is no measure: with GPS in gusts or on a busy
host the estimate of it goes beyond 0.15 m/s again and again, and the takeoff of a hovering vehicle was never over."""
_STAYS_NS: Final = 3_000_000_000
"""A rest that began far below the height is one after so long. PX4 that brakes rests as well: 0.13 m in more than a
second were seen at 0.95 of 1.5 m, before it climbed on."""


_READ_NS: Final = 1_500_000_000
"""PX4's navigator reads parameters once a second at most: a takeoff that comes sooner climbs to the height before."""


class HeightRead:
    """Whether PX4 has had the time to read a height that was set when it told `before`."""

    def __init__(self, before: VehicleState) -> None:
        self._before = before

    def is_over(self, state: VehicleState) -> bool:
        """Raises GaveWayError when mode or arming changed meanwhile."""
        if (state.mode, state.armed) != (self._before.mode, self._before.armed):
            raise GaveWayError(f"takeoff: {state.mode} and armed {state.armed} meanwhile; somebody else decided")
        return state.t_mono_ns - self._before.t_mono_ns >= _READ_NS


class Climb:
    """One takeoff from `ground_m` (Up of the local frame) to `height_m` above it; `radius_m` is NAV_MC_ALT_RAD."""

    def __init__(self, ground_m: float, height_m: float, radius_m: float) -> None:
        self._ends_m = ground_m + height_m - radius_m - _MARGIN_M
        self._least_m = ground_m + _SHARE * height_m
        self._rests_m = math.inf
        self._rests_since_ns = 0
        self._holds = False

    def hovers(self, state: VehicleState) -> bool:
        """To be asked again and again. Raises GaveWayError when somebody else has decided."""
        if state.mode not in (FlightMode.TAKEOFF, FlightMode.HOLD):
            raise GaveWayError(f"takeoff: the mode became {state.mode} meanwhile; somebody else decided")
        if not state.armed:  # after that whoever arms it again takes off for himself
            raise GaveWayError("takeoff: disarmed meanwhile; somebody else decided")
        if state.mode is FlightMode.TAKEOFF or not state.in_air:
            return False
        if state.p_local_enu_m is None or state.v_local_enu_m_s is None:
            raise GaveWayError("takeoff: the position was lost in the climb")
        height_m = state.p_local_enu_m[2]
        began_low, self._holds = not self._holds and height_m < self._ends_m, True
        rested_ns, is_low = self._rested_ns(height_m, state.t_mono_ns), height_m < self._least_m
        if began_low or (is_low and rested_ns >= _STAYS_NS):
            raise GaveWayError("takeoff: the climb was ended below its height; somebody else decided")
        return not is_low and rested_ns >= (_STILL_NS if self._rests_m >= self._least_m else _STAYS_NS)

    def _rested_ns(self, height_m: float, now_ns: int) -> int:
        if abs(height_m - self._rests_m) > _STILL_M:
            self._rests_m, self._rests_since_ns = height_m, now_ns
        return now_ns - self._rests_since_ns
