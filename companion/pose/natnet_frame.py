"""NatNet datagrams -> one rigid body and its time. No I/O, one error; no count is believed beyond the bytes there.

Layouts as NaturalPoint's own PacketClient of each version takes them apart, little-endian throughout:

- each section begins with a count; from 4.1 on with its bytes too, by which it is skipped whole
- a rigid body: i32 id, 3 x f32 position, 4 x f32 quaternion x y z w; before 3.0 its markers (i32 count, 12 bytes each,
  from 2.0 on 8 more); from 2.0 on f32 error; from 2.6 on u16 whose lowest bit says that it is tracked
- sections: marker sets, other markers, rigid bodies, skeletons (2.1), assets (4.1), labelled markers (2.3), force
  plates (2.9), devices (2.11)
- the end: before 3.0 f32 software latency; 2 x u32 time code; time stamp f64, before 2.7 f32; from 3.0 on 3 x u64, from
  4.1 on 2 x u32 more; u16 flags; i32 end tag, which some servers leave out
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

Version = tuple[int, int]
Vector3 = tuple[float, float, float]

HEADER: Final = struct.Struct("<HH")
_MARKER: Final = 12
_BODY: Final = struct.Struct("<i3f4f")
_ASSET_BODY: Final = _BODY.size + 6
_ASSET_MARKER: Final = 26
_SERVER_NAME: Final = 256
_END_TAG: Final = 4

MOST_METRES: Final = 1000.0
_MOST_NORM_OFF: Final = 0.1
_LEAST_SECONDS: Final = 1e-6
_MOST_SECONDS: Final = 1e9
"""Time stamps count from the start of the server's software."""


class NatNetError(ValueError):
    """A datagram is not what its version says; the message says in which way."""


@dataclass(frozen=True)
class Body:
    """A rigid body in the server's axes: position [m], quaternion x y z w; before 2.6 nothing tells whether it is
    tracked. `t_s` is the server's time of the frame."""

    t_s: float
    position_m: Vector3
    quaternion_xyzw: tuple[float, float, float, float]
    is_tracked: bool


def message_of(datagram: bytes) -> tuple[int, bytes]:
    """Message number and payload. Raises NatNetError."""
    if len(datagram) < HEADER.size:
        raise NatNetError(f"{len(datagram)} bytes, expected a header of {HEADER.size}")
    number, length = HEADER.unpack_from(datagram)
    if length != len(datagram) - HEADER.size:
        raise NatNetError(f"its length field says {length} of {len(datagram) - HEADER.size} bytes")
    return number, datagram[HEADER.size :]


def protocol_version(payload: bytes) -> Version:
    """Of SERVERINFO: name of 256 bytes, version of the software, version of the protocol. Raises NatNetError."""
    if len(payload) < _SERVER_NAME + 8:
        raise NatNetError(f"server information of {len(payload)} bytes, expected {_SERVER_NAME + 8}")
    return payload[_SERVER_NAME + 4], payload[_SERVER_NAME + 5]


def body_in(payload: bytes, version: Version, wanted: int) -> Body | None:
    """The rigid body of that streaming id in a FRAMEOFDATA; None where it is not in there. Raises NatNetError, also for
    numbers that are no pose of anything."""
    reader = _FrameReader(payload, version)
    reader.skip_to_bodies()
    found: list[tuple[Vector3, tuple[float, float, float, float], bool]] = []

    def take(section: _FrameReader) -> None:
        number, pose = section.body()
        if number == wanted:
            found.append(pose)

    # Its bytes must be what its count says: its bodies are the only ones that are read.
    reader.section(_BODY.size, take, is_read=True)
    for since, least, skip in _AFTER_BODIES:
        if version >= since:
            reader.section(least, skip)
    t_s = reader.time_s()
    if not found:
        return None
    position_m, quaternion, is_tracked = found[0]
    body = Body(t_s, position_m, quaternion, is_tracked)
    if is_tracked:
        _check(body)
    return body


def ids_in(payload: bytes, version: Version) -> list[int]:
    """The streaming ids of all rigid bodies in a FRAMEOFDATA. Raises NatNetError."""
    reader, ids = _FrameReader(payload, version), list[int]()
    reader.skip_to_bodies()
    reader.section(_BODY.size, lambda section: ids.append(section.body()[0]), is_read=True)
    return ids


def _check(body: Body) -> None:
    if not all(abs(value) < MOST_METRES for value in body.position_m):
        raise NatNetError(f"position {body.position_m} m, expected within {MOST_METRES:g} m")
    norm = math.hypot(*body.quaternion_xyzw)
    if not abs(norm - 1.0) < _MOST_NORM_OFF:
        raise NatNetError(f"quaternion of length {norm:g}, expected 1")


class _FrameReader:
    """Reads forward; what would leave the datagram is an error."""

    def __init__(self, data: bytes, version: Version) -> None:
        self._data = data
        self._version = version
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def skip(self, count: int) -> None:
        if not 0 <= count <= self.left:
            raise NatNetError(f"{count} bytes at {self._at}, of which {self.left} are there")
        self._at += count

    def skip_to_bodies(self) -> None:
        self.skip(4)  # number of the frame
        self.section(5, _FrameReader.skip_marker_set)
        self.section(_MARKER, lambda section: section.skip(_MARKER))

    def count(self, least_bytes: int) -> int:
        """Of things that take so many bytes each, at least."""
        start = self._at
        self.skip(4)
        (number,) = struct.unpack_from("<i", self._data, start)
        if not 0 <= number <= self.left // least_bytes:
            raise NatNetError(f"a count of {number} at {start}, with {self.left} bytes left")
        return int(number)

    def section(self, least_bytes: int, take: Callable[[_FrameReader], None], is_read: bool = False) -> None:
        number = self.count(least_bytes)
        if self._version >= (4, 1):
            size = self.count(1)
            end = self._at + size
            if not is_read:
                self.skip(size)
                return
        for _ in range(number):
            take(self)
        if self._version >= (4, 1) and self._at != end:
            raise NatNetError(f"a section of {size} bytes, of which {number} rigid bodies fill others")

    def body(self) -> tuple[int, tuple[Vector3, tuple[float, float, float, float], bool]]:
        start = self._at
        self.skip(_BODY.size)
        number, x, y, z, qx, qy, qz, qw = _BODY.unpack_from(self._data, start)
        if self._version < (3, 0):
            markers = self.count(_MARKER)
            self.skip(markers * (_MARKER + (8 if self._version >= (2, 0) else 0)))
        if self._version >= (2, 0):
            self.skip(4)
        is_tracked = True
        if self._version >= (2, 6):
            self.skip(2)
            is_tracked = bool(self._data[self._at - 2] & 1)
        return number, ((x, y, z), (qx, qy, qz, qw), is_tracked)

    def skip_marker_set(self) -> None:
        """Its name, whatever its encoding, and its markers."""
        end = self._data.find(b"\0", self._at)
        self.skip((end if end >= 0 else len(self._data)) - self._at + 1)
        self.skip(_MARKER * self.count(_MARKER))

    def skip_skeleton(self) -> None:
        self.skip(4)
        for _ in range(self.count(_BODY.size)):
            self.body()

    def skip_labelled_marker(self) -> None:
        self.skip(20 + 2 * (self._version >= (2, 6)) + 4 * (self._version >= (3, 0)))

    def skip_asset(self) -> None:
        self.skip(4)
        self.skip(_ASSET_BODY * self.count(_ASSET_BODY))
        self.skip(_ASSET_MARKER * self.count(_ASSET_MARKER))

    def skip_channels(self) -> None:
        self.skip(4)
        for _ in range(self.count(4)):
            self.skip(4 * self.count(4))

    def time_s(self) -> float:
        """Of the end, which must fill the datagram."""
        self.skip(8 + (4 if self._version < (3, 0) else 0))
        layout = struct.Struct("<d" if self._version >= (2, 7) else "<f")
        start = self._at
        self.skip(layout.size)
        (t_s,) = layout.unpack_from(self._data, start)
        stamps = 24 * (self._version >= (3, 0))
        precise = 8 * (self._version >= (4, 1))
        if self.left - stamps - precise not in (2, 2 + _END_TAG):
            raise NatNetError(f"{self.left} bytes behind the time stamp, expected {stamps + precise + 2} or 4 more")
        if t_s != 0 and not _LEAST_SECONDS < t_s < _MOST_SECONDS:
            raise NatNetError(f"time stamp {t_s!r} s, expected the seconds since the server's start")
        return float(t_s)


_AFTER_BODIES: Final = (
    ((2, 1), 8, _FrameReader.skip_skeleton),
    ((4, 1), 12, _FrameReader.skip_asset),
    ((2, 3), 20, _FrameReader.skip_labelled_marker),
    ((2, 9), 8, _FrameReader.skip_channels),
    ((2, 11), 8, _FrameReader.skip_channels),
)
"""Since which version, least bytes of each of its things, how one of them is skipped."""
