"""The kernel connector's message around a record: nlmsghdr (16 bytes), cn_msg (20), code (1), body.

cn_msg.len counts code and body. seq is always 0 with this driver: loss shows only in bfee_count and as ENOBUFS.
"""

from __future__ import annotations

import struct
from typing import Final

from csi_bridge.records import CsiError

_NLMSGHDR: Final = struct.Struct("<IHHII")
_CN_MSG: Final = struct.Struct("<IIIIHH")
_NLMSG_DONE: Final = 3
_DATA_START: Final = _NLMSGHDR.size + _CN_MSG.size


def encode_message(connector_idx: int, code: int, body: bytes) -> bytes:
    """The datagram in which the driver reports one record."""
    data = bytes([code]) + body
    header = _NLMSGHDR.pack(_DATA_START + len(data), _NLMSG_DONE, 0, 0, 0)
    return header + _CN_MSG.pack(connector_idx, 1, 0, 0, len(data), 0) + data


def connector_idx_of(datagram: bytes) -> int:
    """The connector index a message is of. Raises CsiError where it is too short to say."""
    if len(datagram) <= _DATA_START:
        raise CsiError(f"message of {len(datagram)} bytes, expected more than {_DATA_START}")
    return int(_CN_MSG.unpack_from(datagram, _NLMSGHDR.size)[0])


def decode_message(datagram: bytes, connector_idx: int) -> tuple[int, bytes]:
    """(code, body) of a datagram. Raises CsiError for anything but one whole message of `connector_idx`."""
    idx = connector_idx_of(datagram)
    total = _NLMSGHDR.unpack_from(datagram)[0]
    length = _CN_MSG.unpack_from(datagram, _NLMSGHDR.size)[4]
    if idx != connector_idx:
        raise CsiError(f"connector index {idx}, expected {connector_idx}", _NLMSGHDR.size)
    if length == 0 or _DATA_START + length > min(total, len(datagram)):
        raise CsiError(f"message of {len(datagram)} bytes says {total} with {length} of data", 0)
    data = datagram[_DATA_START : _DATA_START + length]
    return data[0], data[1:]
