"""The vehicle's local frame as the flight uses it: the Up at which it stood, and what was set anew. Pure."""

from __future__ import annotations

import math
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3, VehicleState

_STEP_M: Final = 0.3
_STEPS_NS: Final = NS_PER_S // 4
"""A reset is announced by another message than the position that shows it, at 20 Hz."""


class LocalFrame:
    """`follow` is told of every tick."""

    def __init__(self) -> None:
        self.ground_m = 0.0
        """Up where it stood last, as it then was: the estimate wanders by half a metre before a takeoff. Heights of the
        mission are counted from here; 0 for a vehicle that was never seen on the ground."""
        self._reset_m: Vector3 | None = None
        self._before: tuple[int, Vector3, Vector3] | None = None
        self._stepped_ns: int | None = None

    def follow(self, vehicle: VehicleState, now_ns: int) -> Vector3 | None:
        """How far all places of the frame have moved since the tick before; None when they have not."""
        before, self._reset_m = self._reset_m, vehicle.p_reset_enu_m
        self._watch(vehicle, now_ns)
        delta_m = None
        if before is not None and vehicle.p_reset_enu_m != before:
            x, y, z = (now - then for now, then in zip(vehicle.p_reset_enu_m, before, strict=True))
            self.ground_m += z
            self._stepped_ns = None
            delta_m = x, y, z
        if not vehicle.armed and not vehicle.in_air and vehicle.p_local_enu_m is not None:
            self.ground_m = vehicle.p_local_enu_m[2]
        return delta_m

    def is_stepping(self, now_ns: int) -> bool:
        """Whether the position has just jumped, and no reset that explains it has been announced yet."""
        return self._stepped_ns is not None and now_ns - self._stepped_ns < _STEPS_NS

    def _watch(self, vehicle: VehicleState, now_ns: int) -> None:
        p_m, v_m_s, t_ns = vehicle.p_local_enu_m, vehicle.v_local_enu_m_s, vehicle.position_mono_ns
        if p_m is None or v_m_s is None or t_ns is None:
            return
        before, self._before = self._before, (t_ns, p_m, v_m_s)
        if before is None or t_ns <= before[0]:
            return
        dt_s = (t_ns - before[0]) / NS_PER_S
        (x, y, z), (vx, vy, vz) = before[1:]
        if math.dist(p_m, (x + vx * dt_s, y + vy * dt_s, z + vz * dt_s)) > _STEP_M + dt_s:
            self._stepped_ns = now_ns
