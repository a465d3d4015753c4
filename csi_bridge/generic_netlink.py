"""Generic netlink (linux/netlink.h, linux/genetlink.h): messages of a family to bytes and back, and its number."""

from __future__ import annotations

import errno
import os
import socket
import struct
from collections.abc import Iterator
from typing import Final

from csi_bridge.records import CsiError

NETLINK_GENERIC: Final = 16
NLMSG_ERROR: Final = 2
FIRST_FAMILY: Final = 0x10
"""Numbers of families; below it are netlink's own messages, and the connector's."""
_CONTROL, _GET_FAMILY = 0x10, 3
_FAMILY_ID, _FAMILY_NAME = 1, 2
_REQUEST, _ACKNOWLEDGE = 1, 4
_NESTED: Final = 1 << 15
_TYPE_MASK: Final = 0x3FFF
_HEADER: Final = struct.Struct("<IHHII")
_GENERIC: Final = struct.Struct("<BBH")
_ATTRIBUTE: Final = struct.Struct("<HH")
_ERROR: Final = struct.Struct("<i")
_ANSWER_BYTES: Final = 1 << 16


def encode_message(family: int, command: int, attributes: bytes, flags: int = 0) -> bytes:
    """nlmsghdr (16 bytes), genlmsghdr (4), attributes."""
    size = _HEADER.size + _GENERIC.size + len(attributes)
    return _HEADER.pack(size, family, flags, 0, 0) + _GENERIC.pack(command, 1, 0) + attributes


def decode_message(datagram: bytes) -> tuple[int, int, memoryview]:
    """(family, command, attributes) of a message. Raises CsiError for anything but one whole message of a family."""
    start = _HEADER.size + _GENERIC.size
    if len(datagram) < start:
        raise CsiError(f"message of {len(datagram)} bytes, expected at least {start}")
    size, family, *_ = _HEADER.unpack_from(datagram)
    if family < FIRST_FAMILY or not start <= size <= len(datagram):
        raise CsiError(f"message of {len(datagram)} bytes of family {family} says {size}")
    return family, datagram[_HEADER.size], memoryview(datagram)[start:size]


def is_generic(datagram: bytes) -> bool:
    """Whether it calls itself a message of a family."""
    return len(datagram) >= _HEADER.size and _HEADER.unpack_from(datagram)[1] >= FIRST_FAMILY


def attribute(kind: int, value: bytes, nested: bool = False) -> bytes:
    """One attribute, padded to 4 bytes. Raises struct.error for a value over 65531 bytes."""
    size = _ATTRIBUTE.size + len(value)
    return _ATTRIBUTE.pack(size, kind | (_NESTED if nested else 0)) + value + bytes(-size % 4)


def attributes(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """(kind, value) one behind the other. Raises CsiError where one is longer than what is there."""
    at = 0
    while at < len(data):
        if len(data) - at < _ATTRIBUTE.size:
            raise CsiError(f"{len(data) - at} bytes of an attribute, expected at least {_ATTRIBUTE.size}", at)
        size, kind = _ATTRIBUTE.unpack_from(data, at)
        if not _ATTRIBUTE.size <= size <= len(data) - at:
            raise CsiError(f"attribute of {size} bytes, {len(data) - at} are there", at)
        yield kind & _TYPE_MASK, data[at + _ATTRIBUTE.size : at + size]
        at += (size + 3) // 4 * 4


def family_number(opened: socket.socket, name: str) -> int:
    """Asks the kernel. Raises OSError (ENOENT where it has no such family)."""
    wanted = attribute(_FAMILY_NAME, name.encode() + b"\0")
    answer = request(opened, _CONTROL, _GET_FAMILY, wanted)
    try:
        found = dict(attributes(decode_message(answer)[2]))
        return int.from_bytes(found[_FAMILY_ID][:2], "little")
    except (CsiError, KeyError):
        raise OSError(errno.EPROTO, os.strerror(errno.EPROTO)) from None


def request(opened: socket.socket, family: int, command: int, attributes: bytes, acknowledged: bool = False) -> bytes:
    """The kernel's answer, or, where it is to be `acknowledged` alone, its acknowledgement. The socket must block, with
    a time limit. Raises OSError as the kernel says."""
    flags = _REQUEST | (_ACKNOWLEDGE if acknowledged else 0)
    opened.sendto(encode_message(family, command, attributes, flags), (0, 0))
    while True:
        answer, sender = opened.recvfrom(_ANSWER_BYTES)
        if sender[0] != 0 or len(answer) < _HEADER.size + _ERROR.size:
            continue
        kind = _HEADER.unpack_from(answer)[1]
        if kind == NLMSG_ERROR:
            code = -_ERROR.unpack_from(answer, _HEADER.size)[0]
            if code:
                raise OSError(code, os.strerror(code))
        if not acknowledged or kind == NLMSG_ERROR:
            return answer
