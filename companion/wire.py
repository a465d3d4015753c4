"""The datagram robots broadcast to each other: authenticated, compact, independent of wall clocks.

All little-endian:

    header   magic "WSRN", u8 version, u8 role (1 uav, 2 beacon), u16 sender id, u64 boot id, u64 counter,
             u64 base time [ns, sender's monotonic clock], f32 CSI scale, u8 poses, u8 CSI values        (38 bytes)
    pose     u32 time after base [us], 3 x i32 position [0.1 mm], u8 confidence                          (17 bytes)
    CSI      u32 frame counter, u32 time after base [us], u32 NIC time [us], i16 re, i16 im, u8 antenna  (17 bytes)
    trailer  HMAC-SHA256 over all before it, first 16 bytes

Positions are of the antenna, ENU, North-aligned, from the sender's own origin. A CSI value is re + j im times the CSI
scale. The boot id is random per start and the counter rises by one per datagram, so that a receiver can refuse replays
without any clock.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

VERSION = 1
MAX_POSES = 25
MAX_CSI = 50
MIN_KEY_BYTES = 32

_MAGIC = b"WSRN"
_HEADER = struct.Struct("<4sBBHQQQfBB")
_POSE = np.dtype([("dt_us", "<u4"), ("p", "<i4", (3,)), ("confidence", "u1")])
_CSI = np.dtype(
    [("frame", "<u4"), ("dt_us", "<u4"), ("nic_us", "<u4"), ("re", "<i2"), ("im", "<i2"), ("antenna", "u1")]
)
_TAG_BYTES = 16
_METRES_PER_UNIT = 1e-4
_NS_PER_US = 1000


class WireError(ValueError):
    """A datagram is not one of ours, or not for this version; the message says in which way."""


class Role(IntEnum):
    UAV = 1
    BEACON = 2


@dataclass(frozen=True, slots=True)
class PoseBatch:
    """Poses of the sender: `t_ns` (N,) int64 on its monotonic clock, `p_enu_m` (N, 3), `confidence` (N,) uint8."""

    t_ns: npt.NDArray[np.int64]
    p_enu_m: npt.NDArray[np.float64]
    confidence: npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class CsiBatch:
    """Reverse channels the sender measured, one complex value a frame, all arrays (N,).

    `frame` counter of the exchange, `t_ns` on the sender's monotonic clock, `nic_us` raw NIC time stamp, `value` at the
    channel centre, `antenna` 0..2 that received it.
    """

    frame: npt.NDArray[np.uint32]
    t_ns: npt.NDArray[np.int64]
    nic_us: npt.NDArray[np.uint32]
    value: npt.NDArray[np.complex64]
    antenna: npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Datagram:
    role: Role
    sender: int
    boot_id: int
    counter: int
    poses: PoseBatch
    csi: CsiBatch


def encode(datagram: Datagram, key: bytes) -> bytes:
    """Raises ValueError for more than MAX_POSES poses or MAX_CSI values: the caller batches."""
    poses, csi = datagram.poses, datagram.csi
    if len(poses.t_ns) > MAX_POSES or len(csi.frame) > MAX_CSI:
        raise ValueError(f"{len(poses.t_ns)} poses and {len(csi.frame)} CSI values, at most {MAX_POSES} and {MAX_CSI}")
    base_ns = min([*poses.t_ns.tolist(), *csi.t_ns.tolist()], default=0)
    peak = float(np.max(np.maximum(np.abs(csi.value.real), np.abs(csi.value.imag)), initial=0.0))
    scale = np.float32(peak / 32767 or 1.0)
    pose_rows = np.zeros(len(poses.t_ns), _POSE)
    pose_rows["dt_us"] = (poses.t_ns - base_ns) // _NS_PER_US
    pose_rows["p"] = np.rint(poses.p_enu_m / _METRES_PER_UNIT)
    pose_rows["confidence"] = poses.confidence
    csi_rows = np.zeros(len(csi.frame), _CSI)
    csi_rows["frame"] = csi.frame
    csi_rows["dt_us"] = (csi.t_ns - base_ns) // _NS_PER_US
    csi_rows["nic_us"] = csi.nic_us
    csi_rows["re"] = np.clip(np.rint(csi.value.real / scale), -32767, 32767)
    csi_rows["im"] = np.clip(np.rint(csi.value.imag / scale), -32767, 32767)
    csi_rows["antenna"] = csi.antenna
    header = _HEADER.pack(
        _MAGIC, VERSION, datagram.role, datagram.sender, datagram.boot_id, datagram.counter,
        base_ns, scale, len(pose_rows), len(csi_rows),
    )  # fmt: skip
    body = header + pose_rows.tobytes() + csi_rows.tobytes()
    return body + _tag(body, key)


def resigned(data: bytes, key: bytes) -> bytes:
    """A datagram of a log, whose signature was checked when it arrived, signed anew: a replay has no robot's keys."""
    body = data[:-_TAG_BYTES]
    return body + _tag(body, key)


def sender_of(data: bytes) -> int:
    """The id a datagram claims, to choose the key by. Raises WireError when it is not one of ours."""
    if len(data) < _HEADER.size + _TAG_BYTES:
        raise WireError(f"{len(data)} bytes, expected at least {_HEADER.size + _TAG_BYTES}")
    magic, version, _, sender, *_ = _HEADER.unpack_from(data)
    if magic != _MAGIC:
        raise WireError(f"magic {magic!r}, expected {_MAGIC!r}")
    if version != VERSION:
        raise WireError(f"wire version {version}, this program speaks {VERSION}: update the older robot")
    assert isinstance(sender, int)
    return sender


def decode(data: bytes, key: bytes) -> Datagram:
    """Raises WireError unless `data` is whole, of this version and signed with `key`."""
    sender = sender_of(data)
    body, tag = data[:-_TAG_BYTES], data[-_TAG_BYTES:]
    if not hmac.compare_digest(tag, _tag(body, key)):
        raise WireError(f"signature of sender {sender} is wrong: another key, or a forgery")
    *_, role, _, boot_id, counter, base_ns, scale, n_poses, n_csi = _HEADER.unpack_from(body)
    expected = _HEADER.size + n_poses * _POSE.itemsize + n_csi * _CSI.itemsize
    if len(body) != expected or role not in (Role.UAV, Role.BEACON) or not 0 < scale < np.inf or base_ns >= 1 << 62:
        raise WireError(
            f"sender {sender}: {len(body)} bytes with {n_poses} poses and {n_csi} values, expected {expected}"
        )
    pose_rows = np.frombuffer(body, _POSE, n_poses, _HEADER.size)
    csi_rows = np.frombuffer(body, _CSI, n_csi, _HEADER.size + pose_rows.nbytes)
    return Datagram(
        Role(role),
        sender,
        boot_id,
        counter,
        PoseBatch(
            base_ns + pose_rows["dt_us"].astype(np.int64) * _NS_PER_US,
            pose_rows["p"] * _METRES_PER_UNIT,
            pose_rows["confidence"].copy(),
        ),
        CsiBatch(
            csi_rows["frame"].copy(),
            base_ns + csi_rows["dt_us"].astype(np.int64) * _NS_PER_US,
            csi_rows["nic_us"].copy(),
            ((csi_rows["re"] + 1j * csi_rows["im"]) * scale).astype(np.complex64),
            csi_rows["antenna"].copy(),
        ),
    )


def _tag(body: bytes, key: bytes) -> bytes:
    return hmac.digest(key, body, hashlib.sha256)[:_TAG_BYTES]
