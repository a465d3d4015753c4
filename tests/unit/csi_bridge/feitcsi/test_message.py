"""A report in its vendor event, by hand and back."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.message import decode_event, encode_event
from csi_bridge.feitcsi.rate import Format
from csi_bridge.records import CsiError
from tests.feit_records import record, with_field

BODY = encode_record(record(Format.HT, 20))


def test_layout_by_hand() -> None:
    def attribute(kind: int, value: bytes) -> bytes:
        return struct.pack("<HH", 4 + len(value), kind) + value

    report = attribute(0x4D, BODY[:272]) + attribute(0x4E, BODY[272:])
    inside = (
        attribute(195, struct.pack("<I", 0x1735)) + attribute(196, struct.pack("<I", 0x24)) + attribute(197, report)
    )
    wiphy = attribute(1, struct.pack("<I", 0))
    message = struct.pack("<IHHII", 20 + len(wiphy + inside), 31, 0, 9, 0) + bytes([103, 1, 0, 0]) + wiphy + inside
    assert decode_event(message) == decode_event(message, 31) == BODY
    with pytest.raises(CsiError, match="of family 31, expected 103 of 30"):
        decode_event(message, 30)
    assert decode_event(encode_event(BODY, 31), 31) == BODY


@pytest.mark.parametrize(
    ("at", "layout", "value", "message"),
    [
        (4, "<H", 3, "of family 3"),
        (0, "<I", 5000, "says 5000"),
        (16, "<B", 102, "command 102"),
        (24, "<I", 0x1736, "vendor 0x1736"),
        (36, "<H", 9000, "attribute of 9000 bytes"),
        (42, "<H", 0x4F, "expected header 0x4d"),
    ],
)
def test_what_is_no_report_is_named(at: int, layout: str, value: int, message: str) -> None:
    with pytest.raises(CsiError, match=message):
        decode_event(with_field(encode_event(BODY), at, layout, value))


@given(st.binary(max_size=200))
def test_any_datagram_is_a_report_or_an_error(datagram: bytes) -> None:
    with pytest.raises(CsiError):
        decode_event(datagram)
