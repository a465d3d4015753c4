"""The datagram robots broadcast to each other: authenticated, compact, independent of wall clocks. docs/wire.md has the
layout byte by byte, with an example.

Positions are of the antenna, ENU, North-aligned, from the sender's own origin. Times are of the sender's monotonic
clock. A reverse channel is sent as `wsr.reduced` makes it: 13 bytes that keep what a bearing is made of.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from wsr.reduced import COEFFICIENTS

VERSION: Final = 2
MAX_POSES: Final = 25
MAX_CSI: Final = 50
MIN_KEY_BYTES: Final = 32
UDP_IP_BYTES: Final = 28

_MAGIC: Final = b"WSRN"
_HEADER: Final = struct.Struct("<4sBBHQQqBBBBiiiIII")
_POSE: Final = np.dtype([("age", "<u2"), ("dp", "<i2", (3,))])
_CSI: Final = np.dtype(
    [
        ("frame", "u1"),
        ("nic", "u1", (3,)),
        ("scale", "u1"),
        ("power", "i1"),
        ("coefficients", "u1", (COEFFICIENTS * 2 * 6 // 8,)),
    ]
)
POSE_BYTES: Final = _POSE.itemsize
CSI_BYTES: Final = _CSI.itemsize
_TAG_BYTES: Final = 16
OVERHEAD_BYTES: Final = _HEADER.size + _TAG_BYTES
_METRES_PER_UNIT: Final = 1e-4
_NS_PER_US: Final = 1000
_NS_PER_AGE: Final = 100_000
_MAX_AGE: Final = (1 << 14) - 1
_NIC_BITS: Final = 22
NIC_SPAN_US: Final = 1 << _NIC_BITS
_COUNTED: Final = 1
MAX_FRAME_STEP: Final = 255
_MAX_METRES: Final = 2e5


class WireError(ValueError):
    """A datagram is not one of ours, or not for this version; the message says in which way."""


class VersionError(WireError):
    """A robot of another version; which of the two must be updated is in the message."""


class SignatureError(WireError):
    """Not signed with any valid key of the sender it names."""


class Role(IntEnum):
    UAV = 1
    BEACON = 2


@dataclass(frozen=True, slots=True)
class PoseBatch:
    """Poses of the sender: `t_ns` (N,) int64 on its monotonic clock, `p_enu_m` (N, 3), `confidence` (N,) 0..3."""

    t_ns: npt.NDArray[np.int64]
    p_enu_m: npt.NDArray[np.float64]
    confidence: npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class CsiBatch:
    """Reverse channels the sender measured, all arrays (N, ...).

    `frame` counter of the exchange (zero where its driver gives none), `t_ns` on the sender's monotonic clock, `nic_us`
    raw NIC time stamp, `coefficients` (N, 8, 2) and `scale` (N,) as of `wsr.reduced`, `power_dbm` received, `antenna`
    0..2 that received it.
    """

    frame: npt.NDArray[np.uint32]
    t_ns: npt.NDArray[np.int64]
    nic_us: npt.NDArray[np.uint32]
    coefficients: npt.NDArray[np.int8]
    scale: npt.NDArray[np.uint8]
    power_dbm: npt.NDArray[np.int8]
    antenna: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.frame)


@dataclass(frozen=True, slots=True)
class Datagram:
    """`boot_id`: boot number in the upper 32 bits, random in the lower. `sent_ns` on the sender's monotonic clock.
    `counted`: the CSI has frame counters; without them it is paired by time."""

    role: Role
    sender: int
    boot_id: int
    counter: int
    sent_ns: int
    poses: PoseBatch
    csi: CsiBatch
    counted: bool = True


def empty_csi() -> CsiBatch:
    u32, u8 = np.zeros(0, np.uint32), np.zeros(0, np.uint8)
    return CsiBatch(
        u32, np.zeros(0, np.int64), u32, np.zeros((0, COEFFICIENTS, 2), np.int8), u8, np.zeros(0, np.int8), u8
    )


def joined(batches: Sequence[CsiBatch]) -> CsiBatch:
    """One batch of several, in their order."""
    parts = [empty_csi(), *batches]
    return CsiBatch(
        np.concatenate([b.frame for b in parts]),
        np.concatenate([b.t_ns for b in parts]),
        np.concatenate([b.nic_us for b in parts]),
        np.concatenate([b.coefficients for b in parts]),
        np.concatenate([b.scale for b in parts]),
        np.concatenate([b.power_dbm for b in parts]),
        np.concatenate([b.antenna for b in parts]),
    )


def encode(datagram: Datagram, key: bytes) -> bytes:
    """Raises ValueError for a batch that does not fit: too many rows, times or counters too far apart. The caller
    batches what it gathered within a second or so."""
    poses, csi = datagram.poses, datagram.csi
    if len(poses.t_ns) > MAX_POSES or len(csi) > MAX_CSI:
        raise ValueError(f"{len(poses.t_ns)} poses and {len(csi)} CSI values, at most {MAX_POSES} and {MAX_CSI}")
    pose_rows, base_m = _pose_rows(poses, datagram.sent_ns)
    csi_rows, frame, nic_us, age_us = _csi_rows(csi, datagram.sent_ns)
    header = _HEADER.pack(
        _MAGIC, VERSION, datagram.role, datagram.sender, datagram.boot_id, datagram.counter, datagram.sent_ns,
        len(pose_rows), len(csi_rows), _COUNTED if datagram.counted else 0, 0, *base_m, frame, nic_us, age_us,
    )  # fmt: skip
    body = header + pose_rows.tobytes() + csi_rows.tobytes()
    return body + _tag(body, key)


def resigned(data: bytes, key: bytes) -> bytes:
    """A datagram of a log, whose signature was checked when it arrived, signed anew: a replay has no robot's keys."""
    body = data[:-_TAG_BYTES]
    return body + _tag(body, key)


def sender_of(data: bytes) -> int:
    """The id a datagram claims, to choose the key by. Raises WireError when it is not one of ours."""
    if len(data) < OVERHEAD_BYTES:
        raise WireError(f"{len(data)} bytes, expected at least {OVERHEAD_BYTES}")
    if data[:4] != _MAGIC:
        raise WireError(f"magic {data[:4]!r}, expected {_MAGIC!r}")
    if data[4] != VERSION:
        raise VersionError(f"wire version {data[4]}, this program speaks {VERSION}: update the older robot")
    return data[6] | data[7] << 8


def decode(data: bytes, keys: Sequence[bytes]) -> Datagram:
    """Raises WireError unless `data` is whole, of this version and signed with one of `keys`."""
    sender = sender_of(data)
    body, tag = data[:-_TAG_BYTES], data[-_TAG_BYTES:]
    if not any(hmac.compare_digest(tag, _tag(body, key)) for key in keys):
        raise SignatureError(f"signature of sender {sender} is wrong: another key, or a forgery")
    (_, _, role, _, boot_id, counter, sent_ns, n_poses, n_csi, flags, spare, *base, frame, nic_us, age_us) = (
        _HEADER.unpack_from(body)
    )
    expected = _HEADER.size + n_poses * _POSE.itemsize + n_csi * _CSI.itemsize
    sound = role in (Role.UAV, Role.BEACON) and flags <= _COUNTED and spare == 0 and 0 <= sent_ns < 1 << 62
    if len(body) != expected or not sound or n_poses > MAX_POSES or n_csi > MAX_CSI:
        raise WireError(
            f"sender {sender}: {len(body)} bytes with {n_poses} poses and {n_csi} values, expected {expected}"
        )
    pose_rows = np.frombuffer(body, _POSE, n_poses, _HEADER.size)
    csi_rows = np.frombuffer(body, _CSI, n_csi, _HEADER.size + pose_rows.nbytes)
    nic = csi_rows["nic"].astype(np.int64) @ np.array([1, 1 << 8, 1 << 16])
    later_us = nic & ((1 << _NIC_BITS) - 1)
    return Datagram(
        Role(role),
        sender,
        boot_id,
        counter,
        sent_ns,
        PoseBatch(
            sent_ns - (pose_rows["age"] >> 2).astype(np.int64) * _NS_PER_AGE,
            (np.array(base) + pose_rows["dp"]) * _METRES_PER_UNIT,
            (pose_rows["age"] & 3).astype(np.uint8),
        ),
        CsiBatch(
            (frame + csi_rows["frame"].astype(np.int64)).astype(np.uint32),
            # Within one datagram both clocks run alike to ten microseconds.
            sent_ns + (later_us - age_us) * _NS_PER_US,
            (nic_us + later_us).astype(np.uint32),
            _unpacked(csi_rows["coefficients"]),
            csi_rows["scale"].copy(),
            csi_rows["power"].copy(),
            (nic >> _NIC_BITS).astype(np.uint8),
        ),
        bool(flags & _COUNTED),
    )


def _pose_rows(poses: PoseBatch, sent_ns: int) -> tuple[npt.NDArray[np.void], tuple[int, int, int]]:
    rows = np.zeros(len(poses.t_ns), _POSE)
    if not len(rows):
        return rows, (0, 0, 0)
    age = np.rint((sent_ns - poses.t_ns) / _NS_PER_AGE).astype(np.int64)
    far = np.abs(poses.p_enu_m).max()
    if not far < _MAX_METRES:
        raise ValueError(f"a position {far} m from the origin; expected less than {_MAX_METRES}")
    units = np.rint(poses.p_enu_m / _METRES_PER_UNIT).astype(np.int64)
    apart = units - units[0]
    if age.min() < 0 or age.max() > _MAX_AGE or np.abs(apart).max() > 32767:
        raise ValueError("poses must be at most 1.6 s old and within 3.2 m of the first")
    rows["age"] = age << 2 | np.minimum(poses.confidence, 3)
    rows["dp"] = apart
    x, y, z = units[0].tolist()
    return rows, (x, y, z)


def _csi_rows(csi: CsiBatch, sent_ns: int) -> tuple[npt.NDArray[np.void], int, int, int]:
    """Rows, and counter, NIC stamp and age [us] of the first."""
    rows = np.zeros(len(csi), _CSI)
    if not len(rows):
        return rows, 0, 0, 0
    frame = (csi.frame - csi.frame[0]).astype(np.uint32)  # wraps as the counter does
    nic = (csi.nic_us - csi.nic_us[0]).astype(np.uint32)
    age_us = round((sent_ns - int(csi.t_ns[0])) / _NS_PER_US)
    if frame.max() > MAX_FRAME_STEP or nic.max() >= 1 << _NIC_BITS or not 0 <= age_us < 1 << 32:
        raise ValueError("frame counters must rise by less than 256 and NIC stamps by less than 4.19 s")
    packed = nic | csi.antenna.astype(np.uint32) << _NIC_BITS
    rows["frame"] = frame
    rows["nic"] = np.stack([packed & 255, packed >> 8 & 255, packed >> 16 & 255], axis=1)
    rows["scale"], rows["power"], rows["coefficients"] = csi.scale, csi.power_dbm, _packed(csi.coefficients)
    return rows, int(csi.frame[0]), int(csi.nic_us[0]), age_us


def _packed(coefficients: npt.NDArray[np.int8]) -> npt.NDArray[np.uint8]:
    """(N, 8, 2) of -31..31 -> (N, 12): four numbers in three bytes, each plus 32, the first in the lowest bits."""
    fours = (coefficients.reshape(-1, 4).astype(np.int32) + 32) @ np.array([1, 1 << 6, 1 << 12, 1 << 18])
    return np.asarray(fours.astype("<u4")[:, np.newaxis].view(np.uint8)[:, :3]).reshape(len(coefficients), -1)


def _unpacked(packed: npt.NDArray[np.uint8]) -> npt.NDArray[np.int8]:
    fours = packed.reshape(-1, 3).astype(np.int32) @ np.array([1, 1 << 8, 1 << 16])
    parts = (fours[:, np.newaxis] >> np.array([0, 6, 12, 18]) & 63) - 32
    return np.asarray(parts.reshape(len(packed), COEFFICIENTS, 2), np.int8)


def _tag(body: bytes, key: bytes) -> bytes:
    return hmac.digest(key, body, hashlib.sha256)[:_TAG_BYTES]
