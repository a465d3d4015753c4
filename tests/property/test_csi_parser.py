"""Invariants of the parser: whatever the bytes, it gives records or raises CsiError, loses no byte, and terminates."""

from __future__ import annotations

import random
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from csi_bridge.connector import decode_message, encode_message
from csi_bridge.dat_frames import DatFileError, offsets, sound_frames
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, MPDU_CODE, CsiError, CsiRecord
from tests.csi_records import log_of, parsed, record, same
from tests.mutation import mutant

MUTANTS = 8_000


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
    read = parse_body(CSI_CODE, body)
    assert isinstance(read, CsiRecord)
    assert same(read, original)
    assert encode_body(read) == body


@given(st.integers(0, 255), st.binary(max_size=700))
def test_any_body_is_a_record_or_an_error(code: int, body: bytes) -> None:
    try:
        read = parse_body(code, body)
    except CsiError:
        assert code == CSI_CODE
    else:
        assert (read is None) == (code not in (CSI_CODE, MPDU_CODE))


@given(st.lists(records(), min_size=1, max_size=4))
@settings(deadline=None)
def test_a_log_gives_the_records_it_was_made_of(originals: list[CsiRecord]) -> None:
    read = [one for _, one in parsed(log_of(originals))]
    assert all(isinstance(p, CsiRecord) and same(p, o) for p, o in zip(read, originals, strict=True))


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
    log = log_of([record(n_rx, layout=layout) for layout in (20, 34, 38) for n_rx in (1, 1, 2)])
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
    """Takes all; checks that each byte is in one frame, passed over or behind the end; returns what was malformed."""
    try:
        frames = sound_frames(Path("log"), data)
    except DatFileError:
        return 1
    at = 0
    for start, end in offsets(frames):
        assert at <= start < end <= len(data)
        at = end
        if data[start + 2] == CSI_CODE:
            with suppress(CsiError):  # counted as malformed: its length led on, its body was hit
                assert isinstance(parse_body(CSI_CODE, data[start + 3 : end]), CsiRecord)
    covered = sum(int(end - start) for start, end in offsets(frames))
    assert covered + frames.skipped_bytes + frames.truncated_bytes <= len(data)
    return frames.malformed
