"""The datagram in which a camera reader process hands over one pose (standard library only: the T265 reader runs on
CPython 3.10 with nothing else installed).

Little-endian, 68 bytes: magic "PSE1", u64 monotonic time [ns] of the pose on this host (CLOCK_MONOTONIC is shared by
processes), position [m] 3 x f64, quaternion w x y z 4 x f32, velocity [m/s] 3 x f32, u8 tracker confidence 0..3,
u8 frame, u16 session. Values are in the axes that `frame` names; the service converts. The session changes whenever
the tracker began anew, in another frame.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

_LAYOUT = struct.Struct("<4sQ3d4f3fBBH")
_MAGIC = b"PSE1"
DATAGRAM_BYTES = _LAYOUT.size


class PoseFrame(IntEnum):
    """Axes of the values in a datagram."""

    T265 = 1
    """X right, Y up, Z back; yaw arbitrary."""
    ENU = 2
    """X East, Y North, Z up."""


class PoseWireError(ValueError):
    """A datagram is not a pose datagram; the message says in which way."""


_FRAMES = {int(frame): frame for frame in PoseFrame}


class RawPose(NamedTuple):
    """One pose as the tracker gave it, still in the tracker's axes. May hold NaN: a lost T265 sends such poses."""

    t_mono_ns: int
    position_m: tuple[float, float, float]
    quaternion_wxyz: tuple[float, float, float, float]
    velocity_m_s: tuple[float, float, float]
    confidence: int
    frame: PoseFrame
    session: int = 0


def encode(pose: RawPose) -> bytes:
    return _LAYOUT.pack(
        _MAGIC,
        pose.t_mono_ns,
        *pose.position_m,
        *pose.quaternion_wxyz,
        *pose.velocity_m_s,
        pose.confidence,
        int(pose.frame),
        pose.session,
    )


def decode(datagram: bytes) -> RawPose:
    """Raises PoseWireError for anything that `encode` did not make."""
    if len(datagram) != DATAGRAM_BYTES:
        raise PoseWireError(f"{len(datagram)} bytes, expected {DATAGRAM_BYTES}")
    magic, t_mono_ns, x, y, z, qw, qx, qy, qz, vx, vy, vz, confidence, frame, session = _LAYOUT.unpack(datagram)
    if magic != _MAGIC:
        raise PoseWireError(f"magic {magic!r}, expected {_MAGIC!r}")
    if confidence > 3:
        raise PoseWireError(f"confidence {confidence}, expected 0..3")
    axes = _FRAMES.get(frame)
    if axes is None:
        raise PoseWireError(f"frame {frame}, expected one of {list(_FRAMES)}")
    return RawPose(
        t_mono_ns=t_mono_ns,
        position_m=(x, y, z),
        quaternion_wxyz=(qw, qx, qy, qz),
        velocity_m_s=(vx, vy, vz),
        confidence=confidence,
        frame=axes,
        session=session,
    )
