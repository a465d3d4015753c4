"""Whether a takeoff has ended where it should. Pure.

PX4 goes from TAKEOFF to HOLD by itself once it is within NAV_MC_ALT_RAD of the height (0.8 m by default), and climbs on
to the height in HOLD. So a HOLD that begins further down is a person's or a failsafe's, and so is one that comes to
rest far below the height.
"""

from __future__ import annotations

from typing import Final

from companion.autopilot.port import GaveWayError
from companion.core.messages import FlightMode, VehicleState

_SHARE: Final = 0.7
_MARGIN_M: Final = 0.3
"""By which the height may be misjudged: the estimate's Up wanders on the ground."""
_STILL_M_S: Final = 0.15
_STILL_NS: Final = 1_000_000_000


class Climb:
    """One takeoff from `ground_m` (Up of the local frame) to `height_m` above it; `radius_m` is NAV_MC_ALT_RAD."""

    def __init__(self, ground_m: float, height_m: float, radius_m: float) -> None:
        self._ends_m = ground_m + height_m - radius_m - _MARGIN_M
        self._least_m = ground_m + _SHARE * height_m
        self._still_since_ns: int | None = None
        self._holds = False

    def hovers(self, state: VehicleState) -> bool:
        """To be asked again and again. Raises GaveWayError when somebody else has decided."""
        if state.mode not in (FlightMode.TAKEOFF, FlightMode.HOLD):
            raise GaveWayError(f"takeoff: the mode became {state.mode} meanwhile; somebody else decided")
        if state.mode is FlightMode.TAKEOFF or not state.in_air:
            return False
        if state.p_local_enu_m is None or state.v_local_enu_m_s is None:
            raise GaveWayError("takeoff: the position was lost in the climb")
        height_m = state.p_local_enu_m[2]
        began_low, self._holds = not self._holds and height_m < self._ends_m, True
        is_still = self._is_still(state.v_local_enu_m_s[2], state.t_mono_ns)
        if began_low or (is_still and height_m < self._least_m):
            raise GaveWayError("takeoff: the climb was ended below its height; somebody else decided")
        return is_still

    def _is_still(self, climb_m_s: float, now_ns: int) -> bool:
        if abs(climb_m_s) > _STILL_M_S:
            self._still_since_ns = None
        elif self._still_since_ns is None:
            self._still_since_ns = now_ns
        return self._still_since_ns is not None and now_ns - self._still_since_ns >= _STILL_NS
