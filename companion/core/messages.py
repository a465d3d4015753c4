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


@dataclass(frozen=True, slots=True, kw_only=True)
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
    """For the log: 89 bytes, little-endian: i64 time [ns], 3 x f64 position, 4 x f64 quaternion w x y z, 3 x f64
    velocity, u8 confidence. Exact, and cheap at 200 Hz."""
    return _POSE.pack(pose.t_mono_ns, *pose.p_enu_m, *pose.q_enu_from_body, *pose.v_enu_m_s, pose.confidence)


def pose_of(data: bytes) -> Pose:
    """The inverse of `pose_bytes`, whatever stands behind. Raises struct.error for too few bytes."""
    t_ns, x, y, z, qw, qx, qy, qz, vx, vy, vz, confidence = _POSE.unpack_from(data)
    return Pose(
        t_mono_ns=t_ns,
        p_enu_m=(x, y, z),
        q_enu_from_body=(qw, qx, qy, qz),
        v_enu_m_s=(vx, vy, vz),
        confidence=confidence,
    )


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


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsFix:
    """A fix in three dimensions of the vehicle's GPS receiver; None for what it does not tell."""

    t_mono_ns: int
    latitude_deg: float
    longitude_deg: float
    hae_m: float | None
    """Height above the WGS-84 ellipsoid."""
    horizontal_m: float | None
    """Deviation, as `vertical_m`."""
    vertical_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleState:
    """The newest telemetry as one snapshot. Fields that were never received are None."""

    t_mono_ns: int
    """When the snapshot was taken."""
    heartbeat_mono_ns: int | None = None
    """When the newest HEARTBEAT arrived; None before the first."""
    mode: FlightMode | None = None
    mode_mono_ns: int | None = None
    """When the mode was last told (HEARTBEAT or CURRENT_MODE)."""
    offboard_left: int = 0
    """How often it has told another mode after OFFBOARD: a mode that was lost and is back shows in nothing else."""
    armed: bool = False
    in_air: bool = False
    landed_unknown: bool = False
    """It has not told whether it is in the air."""
    failsafe: bool = False
    """The autopilot flies one of its own emergency procedures."""
    position_mono_ns: int | None = None
    p_local_enu_m: Vector3 | None = None
    v_local_enu_m_s: Vector3 | None = None
    yaw_enu_rad: float | None = None
    """Heading of the nose, counter-clockwise from East."""
    battery_remaining: float | None = None
    """0..1: the lowest of all batteries that have told it lately; None when none has."""
    estimator_mono_ns: int | None = None
    """When the estimator last told of itself."""
    estimator_healthy: bool = False
    """Attitude, velocity and position are estimated from real measurements (ESTIMATOR_STATUS), which come now."""
    position_is_global: bool | None = None
    """Whether the estimator knows where on Earth it is, which hold and return need; None when it has not told."""
    timesync_mono_ns: int | None = None
    """When the autopilot last asked for our time (TIMESYNC)."""
    rc_mono_ns: int | None = None
    rc_us: tuple[int, ...] = ()
    """Pulse widths of the RC channels, first to last; empty without RC."""
    battery_mono_ns: int | None = None
    """When the battery that `battery_remaining` is of told it; without one, when any last told something."""
    batteries_unknown: tuple[int, ...] = ()
    """Ids of batteries that were heard and now are silent, or do not know how full they are."""
    can_arm: bool | None = None
    """The autopilot's own arming checks pass for the mode it is in; False too where it has not told lately, None where
    its firmware never tells."""
    arming_reasons: tuple[str, ...] = ()
    """Why they do not, as far as it has told."""
    intended_mode: FlightMode | None = None
    """What was asked for. In a failsafe it stays while another mode flies, and comes back with its cause's end."""
    system_id: int | None = None
    """The one vehicle this service speaks to."""
    are_two: bool = False
    """Two vehicles answer by that id."""
    autopilot: str = ""
    """What its heartbeat says it is, for example "px4"."""
    firmware: str = ""
    """Its version, for example "1.16.1"; empty until it has told."""
    boots: int = 0
    """How often it has been seen to restart. What it said before a restart is forgotten."""
    boot_ms: int | None = None
    """Its own time since its start, as it last told it."""
    clock_offset_ns: int | None = None
    """Its clock minus ours (CLOCK_MONOTONIC), to within the delay of the link."""
    stood_still_ns: int = 0
    """By how much its clock has leapt ahead of ours so far: our clock stood still then, and this program too."""
    resets: int = 0
    """How often it has announced that its estimate was set anew."""
    p_reset_enu_m: Vector3 = (0.0, 0.0, 0.0)
    """The sum of the steps of `p_local_enu_m` that it announced: a place noted before moves along by the difference."""
    gps: GpsFix | None = None
    """The newest fix, where somebody wants it (`tak.enabled`)."""


@dataclass(frozen=True, slots=True)
class AutopilotEvent:
    """Something the autopilot said (STATUSTEXT or EVENT)."""

    t_mono_ns: int
    severity: int
    """0 emergency .. 7 debug, as in syslog."""
    text: str


@dataclass(frozen=True, slots=True)
class Setpoint:
    """One set point in the autopilot's local frame with ENU axes.

    With a position the velocity feeds it forward; without one (None) the velocity alone is flown. Without a yaw (None)
    the autopilot keeps its heading.
    """

    t_mono_ns: int
    p_local_enu_m: Vector3 | None
    v_local_enu_m_s: Vector3
    yaw_enu_rad: float | None

    def is_finite(self) -> bool:
        position = self.p_local_enu_m or ()
        yaw = () if self.yaw_enu_rad is None else (self.yaw_enu_rad,)
        return all(map(math.isfinite, (*position, *self.v_local_enu_m_s, *yaw)))
