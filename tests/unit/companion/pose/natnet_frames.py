"""Frames of each NatNet version, put together field by field as Motive of that time streams them."""

from __future__ import annotations

import math
import struct

from companion.pose.natnet_frame import Version

VERSIONS = [(2, 5), (2, 6), (2, 7), (2, 8), (2, 9), (2, 10), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]
PLACE = (1.0, 2.0, 3.0)
TURN = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
T_S = 1234.5678


def section(version: Version, *things: bytes) -> bytes:
    body = b"".join(things)
    size = struct.pack("<i", len(body)) if version >= (4, 1) else b""
    return struct.pack("<i", len(things)) + size + body


def rigid_body(version: Version, number: int, place: tuple[float, ...] = PLACE, flags: int = 1) -> bytes:
    data = struct.pack("<i3f4f", number, *place, *TURN)
    if version < (3, 0):
        data += struct.pack("<i", 2) + bytes(2 * 12) + struct.pack("<2i", 7, 8) + struct.pack("<2f", 0.01, 0.01)
    data += struct.pack("<f", 0.001)
    return data + (struct.pack("<H", flags) if version >= (2, 6) else b"")


def frame(
    version: Version,
    names: tuple[bytes, ...] = (b"all", b"Drohne \xe4"),
    bodies: tuple[bytes, ...] | None = None,
    t_s: float = T_S,
    end_tag: bool = True,
) -> bytes:
    """The payload of a FRAMEOFDATA with something in every section that the version has."""
    data = struct.pack("<i", 99)
    data += section(version, *(name + b"\0" + struct.pack("<i3f", 1, 9, 9, 9) for name in names))
    data += section(version, struct.pack("<3f", 4, 5, 6))
    data += section(version, *(bodies or (rigid_body(version, 3, (7, 7, 7)), rigid_body(version, 7))))
    if version >= (2, 1):
        data += section(version, struct.pack("<ii", 1, 1) + rigid_body(version, 7, (8, 8, 8)))
    if version >= (4, 1):
        asset_body = struct.pack("<i3f4ffH", 7, 6, 6, 6, *TURN, 0.0, 1)
        data += section(version, struct.pack("<ii", 5, 1) + asset_body + struct.pack("<i", 1) + bytes(26))
    if version >= (2, 3):
        marker = struct.pack("<i3ff", 1, 1, 1, 1, 0.01)
        marker += struct.pack("<H", 2) if version >= (2, 6) else b""
        marker += struct.pack("<f", 0.5) if version >= (3, 0) else b""
        data += section(version, marker, marker)
    channels = struct.pack("<ii", 1, 2) + struct.pack("<i2f", 2, 1, 2) + struct.pack("<i1f", 1, 3)
    if version >= (2, 9):
        data += section(version, channels)
    if version >= (2, 11):
        data += section(version, channels)
    if version < (3, 0):
        data += struct.pack("<f", 0.004)  # software latency
    data += struct.pack("<II", 0x01020304, 5)
    data += struct.pack("<d" if version >= (2, 7) else "<f", t_s)
    if version >= (3, 0):
        data += struct.pack("<3Q", 10**9, 10**9, 10**9)
    if version >= (4, 1):
        data += struct.pack("<II", 1, 2)
    return data + struct.pack("<H", 0) + (struct.pack("<i", 0) if end_tag else b"")


def datagram(number: int, payload: bytes) -> bytes:
    return struct.pack("<HH", number, len(payload)) + payload


def server_info(version: Version) -> bytes:
    return datagram(1, b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0)) + bytes((*version, 0, 0)))
