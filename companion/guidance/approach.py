"""The path under the set points: continuous, towards what is known of the target, wound so that no aperture is flat."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from companion.config.schema import MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3
from companion.guidance.choice import Craft, Way, choose
from companion.guidance.clearance import clear_of
from companion.guidance.motion import Motion
from companion.guidance.steering import Aim, climb, kept_inside, search, towards
from companion.guidance.target import Scatter
from companion.safety.gate import GateLimits

_YAW_RATE_RAD_S: Final = math.radians(30.0)
_LONGEST_TICK_S: Final = 0.2
_FENCE_MARGIN_M: Final = 0.3
_PULL_PER_S: Final = 0.8
"""How much of its distance from the path a vehicle that is led by velocities is led back in a second."""
_CIRCLE_M: Final = 0.35
"""On the circle around a target it is so much farther than the least distance from it,"""
_LEAST_CIRCLE_M: Final = 0.8
"""and on the level not nearer than this: its height is known less well than its place, and from above it has no
azimuth."""
_WITHIN: Final = 0.75
"""Of the range of arrival: so near in space the vehicle comes on its circle, and leaves its height for it where a
target is too far below or above. The rest is room for what is not known."""
_SURE_WEAVE: Final = 0.4
"""The share of the weave that is left while the direction is sure."""
_NEAR_WEAVE: Final = 0.5
"""What is left from near: there a range must show, which takes an aperture that is deep in all directions."""
_NEAR_M: Final = (6.0, 3.0)
"""From afar to near."""
_WEAVE_GAIN: Final = 1.3
"""The motion's filter takes this off the weave."""


class Approach:
    """Makes one set point for each tick. Neither the position it commands nor its velocity ever jumps."""

    def __init__(self, mission: MissionConfig, limits: GateLimits, length_m: float) -> None:
        """`length_m` of path are one turn of the weave."""
        self._mission = mission
        self._limits = limits
        self._away_m = limits.min_neighbour_m + _CIRCLE_M
        self._turn_per_m = math.tau / length_m
        self._turns = mission.yaw == "target"
        self._motion = Motion(mission.acceleration_m_s2)
        self._yaw_rad = 0.0
        self._tick_ns: int | None = None
        self._ground_m = 0.0
        rate = self._turn_per_m * mission.speed_m_s
        most_m = 0.8 * mission.acceleration_m_s2 / rate**2
        self._craft = Craft(
            speed_m_s=mission.speed_m_s,
            acceleration_m_s2=mission.acceleration_m_s2,
            length_m=length_m,
            across_m=min(mission.lateral_weave_m, most_m),
            up_m=0.0 if mission.vehicle == "rover" else min(mission.vertical_weave_m, most_m),
        )
        self._side = 1
        self._begin_path(0.0)

    def start(
        self,
        p_local_enu_m: Vector3,
        yaw_enu_rad: float,
        ground_m: float = 0.0,
        v_local_enu_m_s: Vector3 = (0.0, 0.0, 0.0),
    ) -> None:
        """Begin from where the vehicle is, with the heading it has. It is kept, since the antenna hears all around,
        unless the nose is to turn to the target. Heights are counted from `ground_m` (Up), where it stood."""
        self._motion.start(p_local_enu_m, v_local_enu_m_s)
        self._yaw_rad, self._ground_m = yaw_enu_rad, ground_m
        self._begin_path(yaw_enu_rad)
        self._side = -self._side
        self._tick_ns = None

    def shift(self, delta_enu_m: Vector3) -> None:
        """The local frame was set anew: all places of it are `delta_enu_m` elsewhere, and nothing has moved."""
        self._motion.shift(delta_enu_m)
        self._ground_m += delta_enu_m[2]

    def setpoint(self, now_ns: int, aim: Aim | None, moving: bool, others_m: Sequence[Vector3] = ()) -> Setpoint:
        """The set point of this tick: towards `aim`, searching without one, around robots at `others_m`; without
        `moving` the vehicle stops."""
        elapsed_s = 0.0 if self._tick_ns is None else (now_ns - self._tick_ns) / NS_PER_S
        self._tick_ns = now_ns
        self._choose(aim, others_m)
        wished = self._wished(aim) if moving else (0.0, 0.0, 0.0)
        wished = clear_of(wished, self._motion.p_m, others_m, self._limits.min_neighbour_m)
        self._motion.step(kept_inside(wished, self._motion.p_m, self._limits, self._ground_m), elapsed_s)
        gone_m = math.hypot(*self._motion.v_m_s) * min(elapsed_s, _LONGEST_TICK_S)
        self._phase_rad += self._turn_per_m * gone_m
        self._searched_m += gone_m
        if self._turns and aim is not None:
            self._turn(aim.azimuth_rad, elapsed_s)
        return Setpoint(now_ns, self._motion.p_m, self._motion.v_m_s, self._yaw_rad)

    def _begin_path(self, heading_rad: float) -> None:
        self._heading_rad, self._searched_m, self._phase_rad = heading_rad, 0.0, 0.0
        self._way: Way | None = None
        """Where motion is chosen: the newest,"""
        self._scatter: Scatter | None = None
        """and what it was chosen for."""

    def _choose(self, aim: Aim | None, others_m: Sequence[Vector3]) -> None:
        """Once for each belief, of an aim that tells where else the target may be."""
        if aim is None or aim.scatter is None:
            self._way = self._scatter = None
        elif aim.scatter is not self._scatter:
            x, y, z = p_m = self._motion.p_m
            flat_m, azimuth = aim.distance_m, aim.azimuth_rad
            target_m = x + flat_m * math.cos(azimuth), y + flat_m * math.sin(azimuth), z + aim.above_m
            before = self._way or Way(0.0, self._side, 1.0)
            near_m = self._near_m(aim)
            self._way = choose(
                aim.scatter,
                target_m,
                p_m,
                near_m,
                craft=self._craft,
                limits=self._limits,
                others_m=others_m,
                before=before,
            )
            self._side, self._scatter = self._way.side, aim.scatter

    def _near_m(self, aim: Aim) -> float:
        """On the level: where it might have arrived; from there on, around the target."""
        arrival_m = math.sqrt(max(0.0, self._mission.arrival_range_m**2 - aim.above_m**2))
        return max(self._circle_m(aim), min(arrival_m, aim.distance_m))

    def _circle_m(self, aim: Aim) -> float:
        return math.sqrt(max(_LEAST_CIRCLE_M**2, self._away_m**2 - aim.above_m**2))

    def _wished(self, aim: Aim | None) -> Vector3:
        mission = self._mission
        drives = mission.vehicle == "rover"
        # A level path that is nearly straight takes a source above it for one beside it, whatever was known before.
        share = 1.0 if aim is None or drives else max(1.0 - (1.0 - _SURE_WEAVE) * aim.sureness, _near_weave(aim))
        way = self._way or Way(0.0, self._side, 0.0)
        # Bounds promise more of straight and thin ways than poses that drift keep.
        share = max(share, way.weave)
        across, up = self._weave(share, 0.0 if drives else mission.vertical_weave_m)
        forward = math.sqrt(max((0.5 * mission.speed_m_s) ** 2, mission.speed_m_s**2 - across**2 - up**2))
        if aim is None:
            ve, vn = search(self._searched_m, self._heading_rad, forward)
        else:
            self._begin_search_at(aim.azimuth_rad)
            ve, vn = towards(aim, forward, self._circle_m(aim), way.side, lead_rad=way.lead_rad)
        speed = max(math.hypot(ve, vn), 1e-6)
        ve, vn = ve - across * vn / speed, vn + across * ve / speed
        if drives:
            return ve, vn, 0.0
        return ve, vn, climb(self._motion.p_m[2], self._height_m(aim), mission.speed_m_s / 2) + up

    def _height_m(self, aim: Aim | None) -> float:
        """The height it took off to; from near one from which the target can be seen to be within the range of arrival,
        on a slope of 1 : 1, and a little above the least height."""
        mission = self._mission
        height_m = self._ground_m + mission.takeoff_height_m
        if aim is None:
            return height_m
        within_m = max(self._away_m, _WITHIN * mission.arrival_range_m)
        most_m = math.sqrt(max(0.0, within_m**2 - _LEAST_CIRCLE_M**2)) + max(0.0, aim.distance_m - _LEAST_CIRCLE_M)
        target_m = self._motion.p_m[2] + aim.above_m
        least_m = self._ground_m + self._limits.min_height_m + _FENCE_MARGIN_M + mission.vertical_weave_m
        return max(min(height_m, least_m), min(max(height_m, target_m - most_m), target_m + most_m))

    def _begin_search_at(self, heading_rad: float) -> None:
        """Where the next search begins: along the way it is flown now."""
        self._heading_rad, self._searched_m = heading_rad, 0.0

    def _weave(self, share: float, vertical_m: float) -> tuple[float, float]:
        """Velocities [m/s] across and up of the helix, `vertical_m` high: one turn in `length_m` of path, as wide as
        acceleration lets it be."""
        mission = self._mission
        rate = self._turn_per_m * mission.speed_m_s
        most_m = 0.8 * mission.acceleration_m_s2 / rate**2
        across_m, up_m = (share * min(wide, most_m) for wide in (mission.lateral_weave_m, vertical_m))
        gain = _WEAVE_GAIN * rate
        return gain * across_m * math.cos(self._phase_rad), -gain * up_m * math.sin(self._phase_rad)

    def _turn(self, azimuth_rad: float, elapsed_s: float) -> None:
        """Nose towards the target, slowly: a fast turn swings the antenna."""
        most = _YAW_RATE_RAD_S * min(elapsed_s, _LONGEST_TICK_S)
        error = math.remainder(azimuth_rad - self._yaw_rad, math.tau)
        self._yaw_rad = math.remainder(self._yaw_rad + max(-most, min(most, error)), math.tau)


def _near_weave(aim: Aim) -> float:
    far_m, near_m = _NEAR_M
    return _NEAR_WEAVE * max(0.0, min(1.0, (far_m - aim.distance_m) / (far_m - near_m)))


def inside(p_local_enu_m: Vector3, limits: GateLimits, ground_m: float) -> Vector3:
    """The place itself, or the nearest to it that lies a little inside the fence and above the least height over the
    ground (Up): where to stand, and to begin the next leg, after the gate has refused one."""
    low = (*limits.fence_min_m[:2], max(limits.fence_min_m[2], ground_m + limits.min_height_m))
    kept = (
        max(a + margin, min(b - margin, p))
        for p, a, b in zip(limits.in_box_axes(p_local_enu_m), low, limits.fence_max_m, strict=True)
        for margin in (min(_FENCE_MARGIN_M, (b - a) / 2),)
    )
    x, y, z = limits.in_enu_axes((next(kept), next(kept), next(kept)))
    reach_m = max(0.0, limits.fence_radius_m - _FENCE_MARGIN_M)
    scale = min(1.0, reach_m / max(math.hypot(x, y), 1e-9))
    return scale * x, scale * y, z


def as_velocity(setpoint: Setpoint, p_local_enu_m: Vector3, limits: GateLimits) -> Setpoint:
    """The same set point as a velocity alone: its own, and back to its position from where the vehicle is, within the
    speed and climb limits."""
    assert setpoint.p_local_enu_m is not None
    vx, vy, vz = (
        v + _PULL_PER_S * (wanted - now)
        for v, wanted, now in zip(setpoint.v_local_enu_m_s, setpoint.p_local_enu_m, p_local_enu_m, strict=True)
    )
    scale = min(1.0, limits.max_speed_m_s / max(math.hypot(vx, vy), 1e-9))
    climb = max(-limits.max_climb_m_s, min(limits.max_climb_m_s, vz))
    return Setpoint(setpoint.t_mono_ns, None, (scale * vx, scale * vy, climb), setpoint.yaw_enu_rad)
