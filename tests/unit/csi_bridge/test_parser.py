"""The parser against hand-made bytes and a bit-by-bit reading of the payload."""

from __future__ import annotations

import struct
from dataclasses import asdict, fields

import numpy as np
import pytest

from csi_bridge.encoder import encode_body
from csi_bridge.parser import channels, parse_body, parse_head
from csi_bridge.records import CSI_CODE, MPDU_CODE, CsiError, CsiRecord, MpduRecord
from tests import csi_records
from tests.csi_records import MAC
from tests.unit.csi_bridge.bodies import read_bits, stock_body


def test_rows_are_put_in_antenna_order() -> None:
    payload = np.random.default_rng(5).bytes(192)
    rows = np.array(read_bits(payload, 3, 1)).reshape(30, 3)
    parsed = parse_body(CSI_CODE, stock_body(3, 1, 0b00_10_01, payload))
    assert isinstance(parsed, CsiRecord)
    # The first payload row was received by antenna B, the second by C, the third by A.
    assert np.array_equal(parsed.csi[:, :, 0], rows[:, [2, 0, 1]])


@pytest.mark.parametrize("layout", [34, 38])
def test_patched_headers_follow_the_stock_one(layout: int) -> None:
    payload = np.random.default_rng(1).bytes(192)
    stock = stock_body(3, 1, 0b100100, payload)
    extra = struct.pack("<II6sI", 1_624_840_302, 99_000, MAC, 4_000_000_001)[: layout - 20]
    parsed = parse_body(CSI_CODE, stock[:20] + extra + payload)
    assert isinstance(parsed, CsiRecord)
    assert parsed.csi.reshape(-1).tolist() == read_bits(payload, 3, 1)
    assert (parsed.layout, parsed.mac) == (layout, MAC)
    assert parsed.host_time_ns == 1_624_840_302_099_000_000
    assert parsed.frame_count == (4_000_000_001 if layout == 38 else None)


@pytest.mark.parametrize(
    ("at", "value", "reason"),
    [(8, 0, "0 x 1 antennas"), (8, 4, "4 x 1 antennas"), (9, 200, "3 x 200"), (16, 191, "payload of 191 bytes")],
)
def test_contradicting_lengths_are_refused(at: int, value: int, reason: str) -> None:
    body = bytearray(stock_body(3, 1, 0b100100, bytes(192)))
    body[at] = value
    with pytest.raises(CsiError, match=reason):
        parse_body(CSI_CODE, bytes(body))


@pytest.mark.parametrize("size", [191, 193])
def test_a_payload_of_the_wrong_size_is_refused_even_where_the_lengths_agree(size: int) -> None:
    with pytest.raises(CsiError, match=f"payload of {size} bytes, expected 192"):
        parse_body(CSI_CODE, stock_body(3, 1, 0b100100, bytes(size)))


@pytest.mark.parametrize("header", [19, 21, 33, 35, 36, 37, 39])
def test_headers_that_no_driver_writes_are_refused(header: int) -> None:
    body = stock_body(3, 1, 0b100100, bytes(192))
    longer = body[:20] + bytes(max(0, header - 20)) + body[20:] if header > 20 else body[:-1]
    with pytest.raises(CsiError, match=f"header of {header} bytes"):
        parse_body(CSI_CODE, longer)


@pytest.mark.parametrize("size", [0, 19, 20, 211, 213, 225])
def test_bodies_of_wrong_size_are_refused(size: int) -> None:
    with pytest.raises(CsiError):
        parse_body(
            CSI_CODE,
            stock_body(3, 1, 0b100100, bytes(300))[:16] + struct.pack("<HH", 192, 0) + bytes(size - 20)
            if size >= 20
            else bytes(size),
        )


def test_other_codes() -> None:
    assert parse_body(MPDU_CODE, b"frame") == MpduRecord(b"frame")
    assert parse_body(0x42, b"whatever") is None


@pytest.mark.parametrize("layout", [20, 34, 38])
def test_the_head_alone_says_all_but_the_channel(layout: int) -> None:
    records = [csi_records.record(2, 2, layout, seed) for seed in range(5)]
    bodies = [encode_body(record) for record in records]
    for record, body, csi in zip(records, bodies, channels(bodies), strict=True):
        head = parse_head(body)
        assert {one.name: getattr(record, one.name) for one in fields(head)} == asdict(head)
        assert np.array_equal(csi, record.csi)


@pytest.mark.parametrize(("at", "value"), [(8, 0), (8, 4), (9, 200), (16, 191)])
def test_a_head_is_refused_in_the_words_of_the_whole(at: int, value: int) -> None:
    body = bytearray(stock_body(3, 1, 0b100100, bytes(192)))
    body[at] = value
    told = []
    for parse in (parse_head, lambda body: parse_body(CSI_CODE, body)):
        with pytest.raises(CsiError) as caught:
            parse(bytes(body))
        told.append(str(caught.value))
    assert told[0] == told[1]
