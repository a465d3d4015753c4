"""A vehicle that gets no nearer to what it believes in looks from elsewhere.

An image of the robot in a wall cannot be flown to: the fence ends the way, the vehicle waits there, and everything it
hears from one place agrees with what it believes. From elsewhere the direct path may be the louder one.
"""

from __future__ import annotations

import math
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.guidance.steering import Aim
from companion.safety.gate import GateLimits

_AROUND_M: Final = 1.5
"""Who stays within this of a place"""
_STAYED_S: Final = 20.0
"""for so long, gets nowhere,"""
_AWAY_M: Final = 3.0
"""if the target is believed to be farther away than this."""
_LEG_M: Final = 5.0
_LEG_S: Final = 20.0
_THERE_M: Final = 1.2
_WAYS: Final = 16
_INSIDE_M: Final = 0.8
"""Places to look from are so far inside the fence."""


class Detour:
    """`follow` is told of each tick of a flight, `begin_anew` of all that interrupts one."""

    def __init__(self, limits: GateLimits) -> None:
        self._limits = limits
        self._anchor: tuple[int, Vector3] | None = None
        self._leg: tuple[int, Vector3] | None = None

    def begin_anew(self) -> None:
        self._anchor = self._leg = None

    def follow(self, now_ns: int, p_m: Vector3, target_m: Vector3 | None) -> None:
        """The vehicle is at `p_m` and believes the target at `target_m`."""
        if target_m is None or math.dist(p_m, target_m) < _AWAY_M:
            self.begin_anew()
            return
        if self._leg is not None:
            until_ns, place_m = self._leg
            if now_ns > until_ns or _level(p_m, place_m) < _THERE_M:
                self.begin_anew()
            return
        if self._anchor is None or _level(p_m, self._anchor[1]) > _AROUND_M:
            self._anchor = now_ns, p_m
        elif now_ns - self._anchor[0] > _STAYED_S * NS_PER_S:
            self._leg = now_ns + round(_LEG_S * NS_PER_S), self._elsewhere(p_m, target_m)

    def aim(self, p_m: Vector3) -> Aim | None:
        """Where to look from; None while the vehicle gets on."""
        if self._leg is None:
            return None
        east, north = (to - at for to, at in zip(self._leg[1][:2], p_m[:2], strict=True))
        return Aim(
            azimuth_rad=math.atan2(north, east), distance_m=math.hypot(east, north), distance_std_m=0.0, sureness=1.0
        )

    def _elsewhere(self, p_m: Vector3, target_m: Vector3) -> Vector3:
        """The place, up to 5 m away, from where the target's bearing differs most: across the way to it, or back."""
        ahead = math.atan2(target_m[1] - p_m[1], target_m[0] - p_m[0])

        def worth(way: float) -> float:
            return _level(p_m, self._clear(p_m, way)) * (1.0 - math.cos(way - ahead))

        ways = [ahead + math.tau * k / _WAYS for k in range(_WAYS)]
        return self._clear(p_m, max(ways, key=worth))

    def _clear(self, p_m: Vector3, way: float) -> Vector3:
        """As far as the fence lets one fly on a way."""
        for half_metres in range(round(2 * _LEG_M), 0, -1):
            far_m = half_metres / 2
            beyond_m = _along(p_m, way, far_m + _INSIDE_M)
            if self._limits.is_in_box(beyond_m) and self._limits.is_in_cylinder(beyond_m):
                return _along(p_m, way, far_m)
        return p_m


def _along(p_m: Vector3, way: float, far_m: float) -> Vector3:
    return p_m[0] + far_m * math.cos(way), p_m[1] + far_m * math.sin(way), p_m[2]


def _level(a_m: Vector3, b_m: Vector3) -> float:
    return math.hypot(a_m[0] - b_m[0], a_m[1] - b_m[1])
