"""FeitCSI bytes to records: one by one, in pieces of any size, and through damage."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.parser import FeitLogParser, parse_record
from csi_bridge.feitcsi.rate import Format
from csi_bridge.feitcsi.records import FeitRecord
from csi_bridge.records import CsiError
from tests.feit_records import KINDS, rate_word, record, same, with_field
from tests.mutation import mutant


def taken(log: bytes, sizes: list[int]) -> tuple[list[FeitRecord], list[CsiError], FeitLogParser]:
    """Records and errors of a log fed in pieces."""
    parser, at, number = FeitLogParser(), 0, 0
    records: list[FeitRecord] = []
    errors: list[CsiError] = []
    while at < len(log):
        size = sizes[number % len(sizes)]
        parser.feed(log[at : at + size])
        at, number = at + size, number + 1
        for _ in range(len(log) + 1):
            try:
                item = parser.next_record()
            except CsiError as error:
                errors.append(error)
                continue
            if item is None:
                break
            records.append(item[1])
        else:
            raise AssertionError("the parser did not come to an end")
    return records, errors, parser


@pytest.mark.parametrize(
    ("at", "layout", "value", "message"),
    [
        (46, "<B", 3, "3 x 1 antennas"),
        (47, "<B", 0, "2 x 0 antennas"),
        (52, "<I", 57, "57 subcarriers, expected 56 of HT 20 MHz"),
        (0, "<I", 440, "440 bytes of data, expected 448"),
        (60, "<I", 4_000_000_000, "power of -4000000000 dBm"),
        (92, "<I", rate_word(Format.EHT, 80), "EHT 80 MHz: its subcarriers are not known"),
        (92, "<I", 0xFFFF, "its subcarriers are not known"),
    ],
)
def test_numbers_that_contradict_each_other_are_named(at: int, layout: str, value: int, message: str) -> None:
    with pytest.raises(CsiError, match=message):
        parse_record(with_field(encode_record(record(Format.HT, 20)), at, layout, value))


def test_a_body_of_another_length_is_no_record() -> None:
    data = encode_record(record(Format.HT, 20))
    assert isinstance(parse_record(data), FeitRecord)
    for wrong in (data[:-1], data + b"x", data[:50], b""):
        with pytest.raises(CsiError):
            parse_record(wrong)


@given(st.lists(st.sampled_from(KINDS), max_size=4), st.lists(st.integers(1, 1500), min_size=1, max_size=5))
@settings(deadline=None, max_examples=40)
def test_any_split_of_a_log_gives_the_same_records(kinds: list[tuple[Format, int]], sizes: list[int]) -> None:
    originals = [record(*kind, seed=number) for number, kind in enumerate(kinds)]
    records, errors, parser = taken(b"".join(map(encode_record, originals)), sizes)
    assert not errors
    assert len(records) == len(originals) and all(map(same, records, originals))
    assert (parser.pending_bytes, parser.skipped_bytes) == (0, 0)


@given(st.binary(max_size=3000), st.lists(st.integers(1, 700), min_size=1, max_size=3))
@settings(deadline=None)
def test_any_bytes_are_consumed_whole(data: bytes, sizes: list[int]) -> None:
    taken(data, sizes)


@pytest.mark.parametrize("size", [700, 1 << 20])
@pytest.mark.parametrize("damage", ["insert", "delete", "header", "garbage"])
def test_damage_costs_the_record_it_hit(damage: str, size: int) -> None:
    good = [encode_record(record(Format.HT, 20, seed=number, stamp_us=number)) for number in range(5)]
    hit = good[2]
    good[2] = {
        "insert": hit[:400] + b"\x55" + hit[400:],
        "delete": hit[:400] + hit[401:],
        "header": with_field(hit, 52, "<I", 99),
        "garbage": bytes(2000),
    }[damage]
    records, errors, _ = taken(b"".join(good), [size])
    assert errors
    assert {0, 1, 3, 4} <= {found.timestamp_low_us for found in records}


def test_a_log_that_ends_in_a_record_says_how_much_of_it_is_there() -> None:
    data = encode_record(record(Format.HT, 20))
    records, errors, parser = taken(data + data[:300], [1 << 20])
    assert (len(records), len(errors), parser.pending_bytes, parser.is_lost) == (1, 0, 300, False)


def test_mutants_of_a_log_lose_little_more_than_what_was_hit() -> None:
    rng = random.Random(14)
    good = [encode_record(record(Format.HT, 20, seed=number, stamp_us=number)) for number in range(12)]
    lost = 0
    for _ in range(200):
        at = rng.randrange(1, 11)
        records, _, _ = taken(b"".join([*good[:at], mutant(good[at], rng), *good[at + 1 :]]), [1 << 20])
        lost += len(set(range(12)) - {found.timestamp_low_us for found in records})
    assert lost <= 200
