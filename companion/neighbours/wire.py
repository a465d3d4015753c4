"""The datagram robots broadcast to each other: authenticated, compact, independent of wall clocks. docs/wire.md has the
layout byte by byte, with an example.

Positions are of the antenna, ENU, North-aligned, from the sender's own origin. Times are of the sender's monotonic
clock. A reverse channel is sent as `wsr.reduced` makes it: 13 bytes that keep what a bearing is made of, less what its
neighbours in time have in common (`companion.neighbours.columns`).
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

from companion.neighbours.bands import OF_5300, coefficients_of
from companion.neighbours.columns import Values, pack, unpack
from companion.neighbours.sightings import Sighting, packed_sightings, unpacked_sightings
from wsr.reduced import COEFFICIENTS

VERSION: Final = 4
_WITHOUT_SIGHTINGS: Final = 3
WIDE_VERSION: Final = 5
"""Of datagrams with channels of an AX card: programs before it refuse these by that number."""
MAX_POSES: Final = 25
MAX_CSI: Final = 50
MIN_KEY_BYTES: Final = 32
FRAME_BYTES: Final = 42
"""Ethernet, IP and UDP headers around a datagram, as a network interface counts them."""

_MAGIC: Final = b"WSRN"
_HEADER: Final = struct.Struct("<4sBBHQQqBBBiiiIIIHII")
_BAND: Final = struct.Struct("<BI")
"""Behind the header in version 5: the band of the channels, and the sender's fine clock at the first of them."""
_POSE_BITS: Final = (14, 2, 16, 16, 16)
"""Age [0.1 ms], confidence, position less that of the first [0.1 mm] plus 32768."""
_COEFFICIENT_BITS: Final = 6
_ROW_BITS: Final = (2, 8, 8)
"""Antenna, scale, power plus 128; behind them the coefficients, two rows of each for every channel, plus 32."""
_STEP_BITS: Final = (8, 22)
"""Counter and card's stamp [us], each less that of the channel before, from the second channel on."""
_FINE_STEP_BITS: Final = (31,)
"""In version 5: the fine clock [3.125 ns] likewise; there are no counters."""
_TICKS_PER_US: Final = 320
_MOST_BYTES: Final = 1400
"""Of a datagram: one that no network has to cut."""
_BESIDES_BYTES: Final = 470
"""What poses and bearings take of it."""
TAG_BYTES: Final = 16
OVERHEAD_BYTES: Final = _HEADER.size + TAG_BYTES
_METRES_PER_UNIT: Final = 1e-4
_NS_PER_US: Final = 1000
_NS_PER_AGE: Final = 100_000
_MAX_AGE: Final = (1 << _POSE_BITS[0]) - 1
NIC_SPAN_US: Final = 1 << _STEP_BITS[1]
_COUNTED: Final = 1
_SIGHTINGS: Final = 2
"""Flag: rows of bearings stand between the header and the columns."""
_FLAGS: Final = _COUNTED | _SIGHTINGS
MAX_FRAME_STEP: Final = 255
_MAX_METRES: Final = 2e5
_HALF_POSITION: Final = 1 << 15
_HALF_COEFFICIENT: Final = 1 << _COEFFICIENT_BITS - 1
_US_BITS: Final = 32


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


@dataclass(frozen=True, slots=True, kw_only=True)
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
    band: int = OF_5300
    """Of all of them, as of `companion.neighbours.bands`; `coefficients` are (N, C, 2) with as many as it has."""
    ticks: npt.NDArray[np.uint32] | None = None
    """Of the sender's fine clock of 3.125 ns, where the band is an AX card's."""

    def __len__(self) -> int:
        return len(self.frame)

    def rows(self, chosen: npt.NDArray[np.intp]) -> CsiBatch:
        """Some of the channels."""
        arrays = {name: getattr(self, name)[chosen] for name in _ARRAYS}
        return CsiBatch(**arrays, band=self.band, ticks=None if self.ticks is None else self.ticks[chosen])


@dataclass(frozen=True, slots=True)
class Echo:
    """A datagram of another robot that the sender has heard: what bounds how long datagrams take, and with it by how
    much the clocks can differ.

    `sent_us` when that `robot` had sent it, of its monotonic clock the lower 32 bits; `held_us` how long after its
    arrival the sender's own datagram left.
    """

    robot: int
    sent_us: int
    held_us: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Datagram:
    """`boot_id`: boot number in the upper 32 bits, random in the lower. `sent_ns` on the sender's monotonic clock.
    `counted`: the CSI has frame counters; without them it is paired by time. `sightings`: bearings as the sender
    measured them, never what it concluded."""

    role: Role
    sender: int
    boot_id: int
    counter: int
    sent_ns: int
    poses: PoseBatch
    csi: CsiBatch
    counted: bool = True
    echo: Echo | None = None
    sightings: tuple[Sighting, ...] = ()


_ARRAYS: Final = ("frame", "t_ns", "nic_us", "coefficients", "scale", "power_dbm", "antenna")


def empty_csi() -> CsiBatch:
    u32, u8 = np.zeros(0, np.uint32), np.zeros(0, np.uint8)
    return CsiBatch(
        frame=u32,
        t_ns=np.zeros(0, np.int64),
        nic_us=u32,
        coefficients=np.zeros((0, COEFFICIENTS, 2), np.int8),
        scale=u8,
        power_dbm=np.zeros(0, np.int8),
        antenna=u8,
    )


def joined(batches: Sequence[CsiBatch]) -> CsiBatch:
    """One batch of several, in their order; of the newest one's band."""
    filled = [batch for batch in batches if len(batch)]
    if not filled:
        return empty_csi()
    same = [batch for batch in filled if batch.band == filled[-1].band]
    arrays = {name: np.concatenate([getattr(batch, name) for batch in same]) for name in _ARRAYS}
    ticks = [batch.ticks for batch in same if batch.ticks is not None]
    return CsiBatch(**arrays, band=same[0].band, ticks=np.concatenate(ticks) if ticks else None)


def most_channels(band: int) -> int:
    """How many of a band's channels one datagram takes, poses beside them. Raises ValueError as `bands.grid_of`."""
    if band == OF_5300:
        return MAX_CSI
    bits = sum(_ROW_BITS) + _FINE_STEP_BITS[0] + 2 * _COEFFICIENT_BITS * coefficients_of(band)
    return min(MAX_CSI, (_MOST_BYTES - OVERHEAD_BYTES - _BESIDES_BYTES) * 8 // bits)


def encode(datagram: Datagram, key: bytes) -> bytes:
    """Raises ValueError for a batch that does not fit: too many rows, times or counters too far apart. The caller
    batches what it gathered within a second or so."""
    poses, csi, echo = datagram.poses, datagram.csi, datagram.echo
    if len(poses.t_ns) > MAX_POSES or len(csi) > MAX_CSI:
        raise ValueError(f"{len(poses.t_ns)} poses and {len(csi)} CSI values, at most {MAX_POSES} and {MAX_CSI}")
    pose_columns, base = _pose_columns(poses, datagram.sent_ns)
    csi_columns, first = _csi_columns(csi, datagram.sent_ns)
    is_wide = len(csi) > 0 and csi.band != OF_5300
    version = WIDE_VERSION if is_wide else VERSION
    header = _HEADER.pack(
        _MAGIC, version, datagram.role, datagram.sender, datagram.boot_id, datagram.counter, datagram.sent_ns,
        len(poses.t_ns), len(csi), _flags(datagram), *base, *first,
        *((0, 0, 0) if echo is None else (echo.robot, echo.sent_us, echo.held_us)),
    )  # fmt: skip
    if is_wide and csi.ticks is not None:
        header += _BAND.pack(csi.band, int(csi.ticks[0]))
    sightings = packed_sightings(datagram.sightings, datagram.sent_ns) if datagram.sightings else b""
    return signed(header + sightings + pack([*pose_columns, *csi_columns]), key)


def sender_of(data: bytes) -> int:
    """The id a datagram claims, to choose the key by. Raises WireError when it is not one of ours."""
    if data[:4] != _MAGIC:
        raise WireError(f"magic {data[:4]!r}, expected {_MAGIC!r}")
    if len(data) > 7 and data[4] not in (VERSION, WIDE_VERSION):
        sender = data[6] | data[7] << 8
        older = f"robot {sender}" if data[4] < VERSION else "this robot"
        raise VersionError(f"robot {sender} speaks wire version {data[4]}, this program {VERSION}: update {older}")
    if len(data) < OVERHEAD_BYTES:
        raise WireError(f"{len(data)} bytes, expected at least {OVERHEAD_BYTES}")
    return data[6] | data[7] << 8


def decode(data: bytes, keys: Sequence[bytes]) -> Datagram:
    """Raises WireError unless `data` is whole, of this version and signed with one of `keys`."""
    sender = sender_of(data)
    body, tag = data[:-TAG_BYTES], data[-TAG_BYTES:]
    if not any(hmac.compare_digest(tag, _tag(body, key)) for key in keys):
        raise SignatureError(f"signature of sender {sender} is wrong: another key, or a forgery")
    (_, version, role, _, boot_id, counter, sent_ns, n_poses, n_csi, flags, *rest) = _HEADER.unpack_from(body)
    base, first, robot, echo = rest[:3], rest[3:6], rest[6], rest[7:]
    sound = role in (Role.UAV, Role.BEACON) and flags <= _FLAGS and 0 <= sent_ns < 1 << 62
    if not sound or n_poses > MAX_POSES or n_csi > MAX_CSI:
        raise WireError(f"sender {sender}: role {role}, flags {flags}, {n_poses} poses and {n_csi} channels")
    try:
        band, ticks, start = OF_5300, 0, _HEADER.size
        if version == WIDE_VERSION:
            band, ticks, start = *_BAND.unpack_from(body, start), start + _BAND.size
            if band == OF_5300 or not n_csi:
                raise ValueError(f"version {WIDE_VERSION} with {n_csi} channels of band {band}")
        sightings, used = unpacked_sightings(body[start:], sent_ns) if flags & _SIGHTINGS else ((), 0)
        columns = unpack(body[start + used :], _shape(n_poses, n_csi, band))
    except (ValueError, struct.error) as error:
        raise WireError(f"sender {sender}: {n_poses} poses and {n_csi} channels: {error}") from None
    return Datagram(
        role=Role(role),
        sender=sender,
        boot_id=boot_id,
        counter=counter,
        sent_ns=sent_ns,
        poses=_poses(columns[: len(_POSE_BITS)] if n_poses else [], np.array(base), sent_ns),
        csi=_csi(columns[len(_POSE_BITS) if n_poses else 0 :], first, sent_ns, band, ticks=ticks)
        if n_csi
        else empty_csi(),
        counted=bool(flags & _COUNTED),
        echo=Echo(robot, *echo) if robot else None,
        sightings=sightings,
    )


def _flags(datagram: Datagram) -> int:
    return (_COUNTED if datagram.counted else 0) | (_SIGHTINGS if datagram.sightings else 0)


def _step_bits(band: int) -> tuple[int, ...]:
    return _STEP_BITS if band == OF_5300 else _FINE_STEP_BITS


def _shape(n_poses: int, n_csi: int, band: int) -> list[tuple[int, int]]:
    """Rows and bits of each column."""
    shape = [(n_poses, bits) for bits in _POSE_BITS] if n_poses else []
    if n_csi:
        shape += [(n_csi - 1, bits) for bits in _step_bits(band)]
        shape += [(n_csi, bits) for bits in _ROW_BITS]
        shape += [(2 * n_csi, _COEFFICIENT_BITS)] * coefficients_of(band)
    return shape


def _pose_columns(poses: PoseBatch, sent_ns: int) -> tuple[list[tuple[Values | list[int], int]], list[int]]:
    """The columns and the first position."""
    if not len(poses.t_ns):
        return [], [0, 0, 0]
    age = [round((sent_ns - t_ns) / _NS_PER_AGE) for t_ns in poses.t_ns.tolist()]
    places_m = poses.p_enu_m.T.tolist()
    if not all(abs(value_m) < _MAX_METRES for values_m in places_m for value_m in values_m):
        far = np.abs(poses.p_enu_m).max()
        raise ValueError(f"a position {far} m from the origin; expected less than {_MAX_METRES}")
    units = [[round(value_m / _METRES_PER_UNIT) for value_m in values_m] for values_m in places_m]
    apart = [[value - values[0] + _HALF_POSITION for value in values] for values in units]
    if min(age) < 0 or max(age) > _MAX_AGE or not all(min(v) > 0 and max(v) < 2 * _HALF_POSITION for v in apart):
        raise ValueError("poses must be at most 1.6 s old and within 3.2 m of the first")
    confidence = [min(value, 3) for value in poses.confidence.tolist()]
    return list(zip((age, confidence, *apart), _POSE_BITS, strict=True)), [values[0] for values in units]


def _poses(columns: list[Values], base: npt.NDArray[np.int64], sent_ns: int) -> PoseBatch:
    if not columns:
        return PoseBatch(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.uint8))
    age, confidence, *apart = columns
    p_enu_m = np.asarray((base + np.stack(apart, axis=1) - _HALF_POSITION) * _METRES_PER_UNIT, np.float64)
    return PoseBatch(sent_ns - age * _NS_PER_AGE, p_enu_m, confidence.astype(np.uint8))


def _csi_columns(csi: CsiBatch, sent_ns: int) -> tuple[list[tuple[Values, int]], tuple[int, int, int]]:
    """The columns; and counter, card's stamp and age [us] of the first channel."""
    if not len(csi):
        return [], (0, 0, 0)
    frame = (csi.frame - csi.frame[0]).astype(np.uint32)  # wraps as the counter does
    nic = (csi.nic_us - csi.nic_us[0]).astype(np.uint32)
    age_us = round((sent_ns - int(csi.t_ns[0])) / _NS_PER_US)
    if frame.max() > MAX_FRAME_STEP or nic.max() >= NIC_SPAN_US or not 0 <= age_us < 1 << _US_BITS:
        raise ValueError("frame counters must rise by less than 256 and NIC stamps by less than 4.19 s")
    # A step back is one round less of the column's own size.
    series = (frame, nic) if csi.ticks is None else ((csi.ticks - csi.ticks[0]).astype(np.uint32),)
    sizes = _step_bits(csi.band)
    steps = [np.diff(v.astype(np.int64)) & (1 << bits) - 1 for v, bits in zip(series, sizes, strict=True)]
    count = coefficients_of(csi.band)
    parts = csi.coefficients.astype(np.int64).transpose(1, 0, 2).reshape(count, -1) + _HALF_COEFFICIENT
    rows = (csi.antenna.astype(np.int64), csi.scale.astype(np.int64), csi.power_dbm.astype(np.int64) + 128)
    columns = [*zip(steps, sizes, strict=True), *zip(rows, _ROW_BITS, strict=True)]
    columns += [(part, _COEFFICIENT_BITS) for part in parts]
    return columns, (int(csi.frame[0]), int(csi.nic_us[0]), age_us)


def _csi(columns: list[Values], first: Sequence[int], sent_ns: int, band: int, *, ticks: int) -> CsiBatch:
    frame, nic_us, age_us = first
    sizes = _step_bits(band)
    *later, last = (
        np.concatenate([[0], np.cumsum(steps)]) & (1 << bits) - 1
        for steps, bits in zip(columns[: len(sizes)], sizes, strict=True)
    )
    later_us = last if band == OF_5300 else np.rint(last / _TICKS_PER_US).astype(np.int64)
    antenna, scale, power, *parts = columns[len(sizes) :]
    coefficients = np.stack(parts).reshape(len(parts), -1, 2).transpose(1, 0, 2) - _HALF_COEFFICIENT
    return CsiBatch(
        frame=(frame + later[0] if later else np.zeros(len(antenna))).astype(np.uint32),
        # Within one datagram both clocks run alike to ten microseconds.
        t_ns=sent_ns + (later_us - age_us) * _NS_PER_US,
        nic_us=(nic_us + later_us).astype(np.uint32),
        coefficients=coefficients.astype(np.int8),
        scale=scale.astype(np.uint8),
        power_dbm=(power - 128).astype(np.int8),
        antenna=antenna.astype(np.uint8),
        band=band,
        ticks=None if band == OF_5300 else (ticks + last).astype(np.uint32),
    )


def signed(body: bytes, key: bytes) -> bytes:
    return body + _tag(body, key)


def signed_anew(data: bytes, key: bytes) -> bytes:
    """A datagram of a log, whose signature was good when it was recorded. One of version 3 is the same without
    bearings, and becomes one of this version; on the air it is refused."""
    if data[4:5] == bytes([_WITHOUT_SIGHTINGS]):
        data = data[:4] + bytes([VERSION]) + data[5:]
    return signed(data[:-TAG_BYTES], key)


def _tag(body: bytes, key: bytes) -> bytes:
    return hmac.digest(key, body, hashlib.sha256)[:TAG_BYTES]
