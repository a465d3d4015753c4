"""Malformed FeitCSI (fault 14): whatever the bytes, the parser's one error or a record, and the stream goes on."""

from __future__ import annotations

import random

from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.message import decode_event, encode_event
from csi_bridge.feitcsi.parser import FeitLogParser, parse_record
from csi_bridge.feitcsi.rate import Format
from csi_bridge.records import CsiError
from tests.faults.campaigns import mutants, runs
from tests.faults.figures import record as note
from tests.feit_records import record
from tests.mutation import mutant

SEED = 14
MUTANTS = mutants()
KINDS = ((Format.OFDM, 20), (Format.HT, 20), (Format.HT, 40), (Format.VHT, 80), (Format.HE, 20))


def test_fault_14_mutated_reports_raise_nothing_but_the_parsers_error() -> None:
    rng = random.Random(SEED)
    messages = [encode_event(encode_record(record(*kind, n_rx))) for kind in KINDS for n_rx in (1, 2)]
    refused = accepted = 0
    for number in range(MUTANTS):
        original = messages[number % len(messages)]
        # The headers decide what happens, so most mutations go there.
        split = rng.choice((44, 44 + 96))
        changed = mutant(original[:split], rng) + original[split:] if rng.random() < 0.8 else mutant(original, rng)
        try:
            parse_record(decode_event(changed))
        except CsiError:
            refused += 1
        else:
            accepted += 1
    assert refused > MUTANTS // 10
    assert accepted > MUTANTS // 10
    note(14, "mutated FeitCSI reports", mutants=MUTANTS, refused=refused, read_as_csi=accepted, other_errors=0)


def test_fault_14_a_mutated_log_loses_little_more_than_what_was_hit() -> None:
    rng = random.Random(SEED)
    good = [encode_record(record(Format.HT, 20, seed=number, stamp_us=number)) for number in range(30)]
    rounds, lost = runs(100, 10_000), 0
    for _ in range(rounds):
        at = rng.randrange(5, 25)
        log = b"".join([*good[:at], mutant(good[at], rng), *good[at + 1 :]])
        parser, found = FeitLogParser(), set()
        parser.feed(log)
        for _ in range(len(log)):
            try:
                item = parser.next_record()
            except CsiError:
                continue
            if item is None:
                break
            found.add(item[1].timestamp_low_us)
        lost += len(set(range(30)) - found)
    assert lost <= 2 * rounds
    note(14, "mutated FeitCSI logs", damaged_records=rounds, records_lost=lost)
