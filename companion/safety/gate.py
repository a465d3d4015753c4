"""The last check before the wire: every set point passes here or becomes a hold. Pure, and it never raises.

The gate keeps no memory: each verdict depends on this set point, this telemetry and this time alone, so a set point
that was refused cannot make the next one pass or fail.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3, VehicleState


class Reason(StrEnum):
    """Why a set point was not sent as it was offered."""

    MODE = "the mode is not ours"
    NO_POSITION = "the vehicle's position is unknown or old"
    NOT_FINITE = "not finite"
    STALE = "too old, or from the future"
    FENCE_BOX = "outside the fence's box"
    FENCE_CYLINDER = "outside the fence's cylinder"
    HEIGHT = "below the minimum height"
    LEAD = "too far ahead of the vehicle"
    SPEED = "too fast"
    CLIMB = "climbs or sinks too fast"
    ACCELERATION = "asks for too much acceleration"
    NEIGHBOUR = "too near to a neighbour"


@dataclass(frozen=True, slots=True, kw_only=True)
class GateLimits:
    """Positions are in the autopilot's local frame with ENU axes; box and cylinder stand about its origin, and the box
    is turned about it by `fence_yaw_deg` counter-clockwise, as a building's walls are.

    Raises ValueError when a limit can never be met.
    """

    fence_min_m: Vector3
    fence_max_m: Vector3
    fence_radius_m: float
    max_speed_m_s: float
    """Horizontal."""
    max_climb_m_s: float
    """Up or down."""
    max_acceleration_m_s2: float
    min_height_m: float
    max_age_s: float = 0.2
    max_lead_m: float = 2.0
    """Distance of the set point from the vehicle. A far position makes the autopilot fly at its own speed limit."""
    response_s: float = 0.5
    """Time the vehicle is given to reach the set point's velocity: the acceleration asked for is their ratio."""
    max_position_age_s: float = 0.5
    fence_yaw_deg: float = 0.0
    on_ground: bool = False
    """The vehicle drives: it has no least height, and nothing may move it up or down."""
    min_neighbour_m: float = 1.0
    """Least distance of a set point from where a neighbour is known to be, unless it leads away from there."""

    def __post_init__(self) -> None:
        if not all(low < high for low, high in zip(self.fence_min_m, self.fence_max_m, strict=True)):
            raise ValueError(
                f"fence_min_m {self.fence_min_m} must lie below fence_max_m {self.fence_max_m} on each axis"
            )
        for name in ("min_height_m", "fence_yaw_deg"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} is {getattr(self, name)}; expected a finite number")
        for name in _POSITIVE:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected a positive number")

    def in_box_axes(self, vector: Vector3) -> Vector3:
        """Of a place or a velocity with ENU axes."""
        return turned(vector, -math.radians(self.fence_yaw_deg))

    def in_enu_axes(self, vector: Vector3) -> Vector3:
        """Of a place or a velocity with the box's axes."""
        return turned(vector, math.radians(self.fence_yaw_deg))

    def is_in_box(self, p_local_enu_m: Vector3) -> bool:
        x, y, z = self.in_box_axes(p_local_enu_m)
        (low_x, low_y, low_z), (high_x, high_y, high_z) = self.fence_min_m, self.fence_max_m
        return low_x <= x <= high_x and low_y <= y <= high_y and low_z <= z <= high_z

    def is_in_cylinder(self, p_local_enu_m: Vector3) -> bool:
        return math.hypot(p_local_enu_m[0], p_local_enu_m[1]) <= self.fence_radius_m


_POSITIVE: Final = (
    "fence_radius_m",
    "max_speed_m_s",
    "max_climb_m_s",
    "max_acceleration_m_s2",
    "max_age_s",
    "max_lead_m",
    "response_s",
    "max_position_age_s",
    "min_neighbour_m",
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What to send: the set point as offered (no reasons), a hold in its place, or None for nothing at all."""

    setpoint: Setpoint | None
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True, slots=True)
class Gate:
    limits: GateLimits

    def check(
        self,
        setpoint: Setpoint,
        state: VehicleState,
        now_ns: int,
        mode_is_ours: bool,
        *,
        neighbours: Sequence[Vector3] = (),
        ground_m: float = 0.0,
    ) -> Verdict:
        """Judge one set point.

        `mode_is_ours` is the caller's: true in OFFBOARD that we asked for, and while the stream warms up for it.
        `neighbours` are the places (local frame, ENU axes) where other robots are known to be. `ground_m` is the Up at
        which the vehicle stood: the local frame's own wanders by half a metre before a takeoff.
        A hold is the vehicle's present position at zero velocity. Without a usable position there is no hold to send:
        nothing goes out, and the autopilot's own loss-of-stream failsafe takes the vehicle.
        """
        if not mode_is_ours:
            return Verdict(None, (Reason.MODE,))
        flown = _flown(state, now_ns, self.limits.max_position_age_s)
        if flown is None:
            return Verdict(None, (Reason.NO_POSITION,))
        p_m, v_m_s, yaw_rad = flown
        reasons = self._reasons(setpoint, p_m, v_m_s, now_ns, neighbours=neighbours, ground_m=ground_m)
        return Verdict(Setpoint(now_ns, p_m, (0.0, 0.0, 0.0), yaw_rad) if reasons else setpoint, reasons)

    def _reasons(
        self,
        setpoint: Setpoint,
        p_m: Vector3,
        v_m_s: Vector3,
        now_ns: int,
        *,
        neighbours: Sequence[Vector3],
        ground_m: float,
    ) -> tuple[Reason, ...]:
        if not setpoint.is_finite():
            return (Reason.NOT_FINITE,)
        limits = self.limits
        wanted_v = setpoint.v_local_enu_m_s
        wanted_p = (
            _led_to(p_m, wanted_v, limits.response_s) if setpoint.p_local_enu_m is None else setpoint.p_local_enu_m
        )
        broken = (
            (Reason.STALE, not 0 <= now_ns - setpoint.t_mono_ns <= limits.max_age_s * NS_PER_S),
            (Reason.FENCE_BOX, not limits.is_in_box(wanted_p)),
            (Reason.FENCE_CYLINDER, not limits.is_in_cylinder(wanted_p)),
            (Reason.HEIGHT, not limits.on_ground and wanted_p[2] < ground_m + limits.min_height_m),
            (Reason.LEAD, math.dist(wanted_p, p_m) > limits.max_lead_m),
            (Reason.SPEED, math.hypot(wanted_v[0], wanted_v[1]) > limits.max_speed_m_s),
            (Reason.CLIMB, abs(wanted_v[2]) > (0.0 if limits.on_ground else limits.max_climb_m_s)),
            (Reason.ACCELERATION, math.dist(wanted_v, v_m_s) > limits.max_acceleration_m_s2 * limits.response_s),
            (Reason.NEIGHBOUR, any(_closes_in(wanted_p, p_m, other, limits.min_neighbour_m) for other in neighbours)),
        )
        return tuple([reason for reason, is_broken in broken if is_broken])


def turned(vector: Vector3, angle_rad: float) -> Vector3:
    """About the vertical, counter-clockwise. Without an angle it is the vector itself, to the last bit."""
    if angle_rad == 0.0:
        return vector
    x, y, z = vector
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * x - s * y, s * x + c * y, z


def _led_to(p_m: Vector3, v_m_s: Vector3, response_s: float) -> Vector3:
    """Where a velocity alone will have taken the vehicle before it can be made to stop: judged as a position is."""
    (x, y, z), (vx, vy, vz) = p_m, v_m_s
    return x + vx * response_s, y + vy * response_s, z + vz * response_s


def _closes_in(wanted_m: Vector3, p_m: Vector3, other_m: Vector3, least_m: float) -> bool:
    """Whether a set point lies too near to another robot. A vehicle that is too near already may stay or go away."""
    distance_m = math.dist(wanted_m, other_m)
    # Written so that a place that is not a number refuses.
    return not (distance_m >= least_m or distance_m >= math.dist(p_m, other_m))


def _flown(state: VehicleState, now_ns: int, max_age_s: float) -> tuple[Vector3, Vector3, float] | None:
    """Position, velocity and yaw as flown; None unless all are known, finite and young."""
    p_m, v_m_s, yaw_rad, t_ns = state.p_local_enu_m, state.v_local_enu_m_s, state.yaw_enu_rad, state.position_mono_ns
    if p_m is None or v_m_s is None or yaw_rad is None or t_ns is None:
        return None
    # Telemetry may arrive between the reading of the clock and of the state: younger than now is fine here.
    if now_ns - t_ns > max_age_s * NS_PER_S or not all(map(math.isfinite, (*p_m, *v_m_s, yaw_rad))):
        return None
    return p_m, v_m_s, yaw_rad
