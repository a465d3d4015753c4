"""What the parts of the companion tell each other: frozen, slotted, with unit and frame in every name.

The world frame is ENU (REP-103). `local` marks the autopilot's own local frame turned to ENU axes: its origin is
where the autopilot's estimator started, its axes point East, North and Up. Vehicle set points live there. Poses
(`Pose`) live in the frame of the pose source (its own origin, axes turned to East, North and Up): only differences of
them are ever used, so the two origins need not agree.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


@dataclass(frozen=True, slots=True)
class Pose:
    """A pose of the vehicle body from a pose source (VIO, motion capture, recording).

    `confidence` is the tracker's own: 0 failed, 1 low, 2 medium, 3 high (T265 numbering).
    """

    t_mono_ns: int
    p_enu_m: Vector3
    q_enu_from_body: Quaternion
    v_enu_m_s: Vector3
    confidence: int


_POSE: Final = struct.Struct("<q3d4d3dB")


def pose_bytes(pose: Pose) -> bytes:
    """Little-endian, 89 bytes: i64 time [ns], 3 x f64 position, 4 x f64 quaternion w x y z, 3 x f64 velocity, u8
    confidence. Exact, and cheap at 200 Hz."""
    return _POSE.pack(pose.t_mono_ns, *pose.p_enu_m, *pose.q_enu_from_body, *pose.v_enu_m_s, pose.confidence)


def pose_of(data: bytes) -> Pose:
    """The inverse of `pose_bytes`. Raises struct.error for another length."""
    t_ns, x, y, z, qw, qx, qy, qz, vx, vy, vz, confidence = _POSE.unpack(data)
    return Pose(t_ns, (x, y, z), (qw, qx, qy, qz), (vx, vy, vz), confidence)


class FlightMode(StrEnum):
    """The autopilot's mode, reduced to what the companion must tell apart."""

    OFFBOARD = "offboard"
    TAKEOFF = "takeoff"
    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    MISSION = "mission"
    MANUAL = "manual"
    """Any mode in which a person flies (manual, altitude, position, stabilised, acro)."""
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class VehicleState:
    """The newest telemetry as one snapshot. Fields that were never received are None."""

    t_mono_ns: int
    """When the snapshot was taken."""
    heartbeat_mono_ns: int | None = None
    """When the newest HEARTBEAT arrived; None before the first."""
    mode: FlightMode | None = None
    mode_mono_ns: int | None = None
    """When the mode was last told (HEARTBEAT or CURRENT_MODE)."""
    armed: bool = False
    in_air: bool = False
    failsafe: bool = False
    """The autopilot flies one of its own emergency procedures."""
    position_mono_ns: int | None = None
    p_local_enu_m: Vector3 | None = None
    v_local_enu_m_s: Vector3 | None = None
    yaw_enu_rad: float | None = None
    """Heading of the nose, counter-clockwise from East."""
    battery_remaining: float | None = None
    """0..1."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """One position set point with velocity feed-forward, in the autopilot's local frame with ENU axes."""

    t_mono_ns: int
    p_local_enu_m: Vector3
    v_local_enu_m_s: Vector3
    yaw_enu_rad: float

    def is_finite(self) -> bool:
        return all(map(math.isfinite, (*self.p_local_enu_m, *self.v_local_enu_m_s, self.yaw_enu_rad)))
