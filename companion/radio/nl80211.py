"""The channel of a wireless interface, asked of the kernel by generic netlink (linux/nl80211.h, linux/genetlink.h)."""

from __future__ import annotations

import errno
import socket
import struct
from collections.abc import Iterator
from typing import Final

_NETLINK_GENERIC: Final = 16
_GENL_ID_CTRL: Final = 0x10
_CTRL_CMD_GETFAMILY: Final = 3
_CTRL_ATTR_FAMILY_ID: Final = 1
_CTRL_ATTR_FAMILY_NAME: Final = 2
_NL80211_CMD_GET_INTERFACE: Final = 5
_NL80211_ATTR_IFINDEX: Final = 3
_NL80211_ATTR_WIPHY_FREQ: Final = 38
_NLM_F_REQUEST: Final = 1
_NLMSG_ERROR: Final = 2
_HEADER: Final = struct.Struct("<IHHII")
_GENERIC: Final = struct.Struct("<BBH")
_ATTRIBUTE: Final = struct.Struct("<HH")
_TIMEOUT_S: Final = 1.0


def channel_mhz(interface: str) -> int | None:
    """Centre of the primary channel, None where none is set. Raises OSError: no such interface, or not wireless."""
    index = socket.if_nametoindex(interface)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, _NETLINK_GENERIC) as opened:
        opened.settimeout(_TIMEOUT_S)
        name = _attribute(_CTRL_ATTR_FAMILY_NAME, b"nl80211\0")
        family = dict(_ask(opened, _GENL_ID_CTRL, _CTRL_CMD_GETFAMILY, name))
        number = struct.unpack("<H", family[_CTRL_ATTR_FAMILY_ID][:2])[0]
        wanted = _attribute(_NL80211_ATTR_IFINDEX, struct.pack("<I", index))
        found = dict(_ask(opened, number, _NL80211_CMD_GET_INTERFACE, wanted))
    value = found.get(_NL80211_ATTR_WIPHY_FREQ)
    return None if value is None else int.from_bytes(value[:4], "little")


def _ask(opened: socket.socket, family: int, command: int, attributes: bytes) -> Iterator[tuple[int, bytes]]:
    body = _GENERIC.pack(command, 1, 0) + attributes
    opened.sendto(_HEADER.pack(_HEADER.size + len(body), family, _NLM_F_REQUEST, 1, 0) + body, (0, 0))
    data = opened.recv(65536)
    size, kind, *_ = _HEADER.unpack_from(data)
    if kind == _NLMSG_ERROR:
        code = -struct.unpack_from("<i", data, _HEADER.size)[0]
        reason = "not a wireless interface" if code in (errno.ENODEV, errno.ENOENT) else "refused"
        raise OSError(code, reason)
    yield from _attributes(data[_HEADER.size + _GENERIC.size : size])


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + _ATTRIBUTE.size <= len(data):
        size, kind = _ATTRIBUTE.unpack_from(data, at)
        if size < _ATTRIBUTE.size:
            return
        yield kind & 0x3FFF, data[at + _ATTRIBUTE.size : at + size]
        at += (size + 3) // 4 * 4


def _attribute(kind: int, value: bytes) -> bytes:
    size = _ATTRIBUTE.size + len(value)
    return _ATTRIBUTE.pack(size, kind) + value + bytes(-size % 4)
