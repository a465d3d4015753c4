"""The message around a report: a vendor event of nl80211, without I/O.

Command 103 with the attributes vendor 0x1735 (195), subcommand 0x24 (196) and data (197), in which 0x4d is the header
and 0x4e the data of the report.
"""

from __future__ import annotations

import struct
from typing import Final

from csi_bridge.feitcsi.records import HEADER_BYTES
from csi_bridge.generic_netlink import attribute, attributes, decode_message, encode_message
from csi_bridge.records import CsiError

FAMILY_NAME: Final = "nl80211"
VENDOR_COMMAND: Final = 103
_IFINDEX, _VENDOR, _SUBCOMMAND, _DATA = 3, 195, 196, 197
_INTEL, _CSI = 0x1735, 0x24
_REPORT_HEADER, _REPORT_DATA = 0x4D, 0x4E
_WORD: Final = struct.Struct("<I")
STAND_IN_FAMILY: Final = 0x1C
"""Number of the family in messages that no kernel has sent."""


def subscription(interface_index: int) -> bytes:
    """Attributes of the command after which the kernel sends reports to the socket that gave it."""
    return attribute(_IFINDEX, _WORD.pack(interface_index)) + _purpose()


def encode_event(body: bytes, family: int = STAND_IN_FAMILY) -> bytes:
    """The datagram in which the driver reports `body`, header and data. Raises struct.error for one too long."""
    report = attribute(_REPORT_HEADER, body[:HEADER_BYTES]) + attribute(_REPORT_DATA, body[HEADER_BYTES:])
    return encode_message(family, VENDOR_COMMAND, _purpose() + attribute(_DATA, report, nested=True))


def decode_event(datagram: bytes, family: int | None = None) -> bytes:
    """Header and data of the report in a datagram, of any family if None. Raises CsiError for any other message."""
    of, command, inside = decode_message(datagram)
    if command != VENDOR_COMMAND or (family is not None and of != family):
        raise CsiError(f"command {command} of family {of}, expected {VENDOR_COMMAND} of {family or 'any'}")
    found = dict(attributes(inside))
    if _number(found, _VENDOR) != _INTEL or _number(found, _SUBCOMMAND) != _CSI:
        raise CsiError(f"event of vendor {_number(found, _VENDOR):#x}, {_number(found, _SUBCOMMAND):#x}: no CSI")
    report = dict(attributes(found.get(_DATA, memoryview(b""))))
    if _REPORT_HEADER not in report or _REPORT_DATA not in report:
        raise CsiError(f"event with {sorted(report)}, expected header {_REPORT_HEADER:#x} and data {_REPORT_DATA:#x}")
    if len(report[_REPORT_HEADER]) != HEADER_BYTES:
        raise CsiError(f"header of {len(report[_REPORT_HEADER])} bytes, expected {HEADER_BYTES}")
    return b"".join((report[_REPORT_HEADER], report[_REPORT_DATA]))


def _purpose() -> bytes:
    return attribute(_VENDOR, _WORD.pack(_INTEL)) + attribute(_SUBCOMMAND, _WORD.pack(_CSI))


def _number(found: dict[int, memoryview], kind: int) -> int:
    value = found.get(kind, memoryview(b""))
    return int(_WORD.unpack(value)[0]) if len(value) == _WORD.size else 0
