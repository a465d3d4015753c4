"""Invariants of the parser: whatever the bytes, it gives records or raises CsiError, loses no byte, and terminates."""

from __future__ import annotations

import random
from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from csi_bridge.connector import decode_message, encode_message
from csi_bridge.encoder import encode_body, encode_file_record, encode_log
from csi_bridge.parser import CsiLogParser, parse_body
from csi_bridge.records import CSI_CODE, MPDU_CODE, CsiError, CsiRecord, MpduRecord
from tests.csi_records import record, same
from tests.mutation import mutant

MUTANTS = 20_000


@st.composite
def records(draw: st.DrawFn) -> CsiRecord:
    layout = draw(st.sampled_from((20, 34, 38)))
    antennas = st.integers(1, 3)
    plain = record(draw(antennas), draw(antennas), layout, draw(st.integers(0, 1000)))
    byte = st.integers(0, 255)
    plain = replace(
        plain,
        timestamp_low_us=draw(st.integers(0, 2**32 - 1)),
        bfee_count=draw(st.integers(0, 2**16 - 1)),
        rssi=(draw(byte), draw(byte), draw(byte)),
        noise_dbm=draw(st.integers(-128, 127)),
        antenna_sel=draw(byte),
        rate=draw(st.integers(0, 2**16 - 1)),
    )
    if layout == 20:
        return plain
    plain = replace(plain, mac=draw(st.binary(min_size=6, max_size=6)))
    return replace(plain, frame_count=draw(st.integers(0, 2**32 - 1))) if layout == 38 else plain


@given(records())
def test_encoder_and_parser_are_inverse(original: CsiRecord) -> None:
    body = encode_body(original)
    parsed = parse_body(CSI_CODE, body)
    assert isinstance(parsed, CsiRecord)
    assert same(parsed, original)
    assert encode_body(parsed) == body


@given(st.integers(0, 255), st.binary(max_size=700))
def test_any_body_is_a_record_or_an_error(code: int, body: bytes) -> None:
    try:
        parsed = parse_body(code, body)
    except CsiError:
        assert code == CSI_CODE
    else:
        assert (parsed is None) == (code not in (CSI_CODE, MPDU_CODE))


@given(st.lists(records(), max_size=4), st.lists(st.integers(1, 300), min_size=1))
@settings(deadline=None)
def test_any_split_of_a_log_gives_the_same_records(originals: list[CsiRecord], cuts: list[int]) -> None:
    log = encode_log(originals)
    parser, at = CsiLogParser(), 0
    parsed: list[object] = []
    while at < len(log):
        size = cuts[len(parsed) % len(cuts)]
        parser.feed(log[at : at + size])
        at += size
        while (item := parser.next_record()) is not None:
            parsed.append(item[1])
    assert len(parsed) == len(originals)
    assert all(isinstance(p, CsiRecord) and same(p, o) for p, o in zip(parsed, originals, strict=True))
    assert parser.pending_bytes == 0


@given(st.binary(max_size=2000))
def test_any_bytes_are_consumed_whole(data: bytes) -> None:
    consume(data)


@given(st.binary(max_size=300), st.integers(0, 30))
def test_any_datagram_is_a_message_or_an_error(datagram: bytes, connector_idx: int) -> None:
    try:
        code, body = decode_message(datagram, connector_idx)
    except CsiError:
        return
    assert encode_message(connector_idx, code, body)[36:] == datagram[36 : 37 + len(body)]


def test_mutants_of_a_log_raise_nothing_but_the_parsers_error() -> None:
    """Flipped, inserted and removed bytes in a log of all layouts."""
    log = encode_log([record(n_rx, layout=layout) for layout in (20, 34, 38) for n_rx in (1, 1, 2)])
    log += encode_file_record(MPDU_CODE, b"frame")
    rng = random.Random(20_210_627)
    broken = sum(consume(mutant(log, rng)) for _ in range(MUTANTS // 10))
    assert broken > MUTANTS // 100


def test_mutants_of_a_body_raise_nothing_but_the_parsers_error() -> None:
    body = encode_body(record())
    rng = random.Random(7)
    refused = 0
    for _ in range(MUTANTS):
        # The header decides what happens, so most mutations go there.
        changed = mutant(body[:20], rng) + body[20:] if rng.random() < 0.8 else mutant(body, rng)
        try:
            parse_body(CSI_CODE, changed)
        except CsiError:
            refused += 1
    assert MUTANTS // 10 < refused < MUTANTS


def consume(data: bytes) -> int:
    """Feeds all and takes all; checks offsets; returns the number of errors."""
    parser, errors, last = CsiLogParser(), 0, -1
    parser.feed(data)
    for _ in range(len(data) + 1):
        try:
            item = parser.next_record()
        except CsiError as error:
            errors, offset = errors + 1, error.offset
        else:
            if item is None:
                assert 0 <= parser.pending_bytes <= len(data)
                return errors
            offset = item[0]
            assert isinstance(item[1], CsiRecord | MpduRecord)
        assert last < offset < len(data)
        last = offset
    raise AssertionError("the parser did not come to an end")
