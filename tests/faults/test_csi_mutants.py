"""Malformed CSI (fault 14): whatever the bytes, the parser's one error or a record, and the stream goes on."""

from __future__ import annotations

import random

from csi_bridge.connector import decode_message, encode_message
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, MPDU_CODE, CsiError, CsiRecord
from tests.csi_records import parsed, record
from tests.faults.campaigns import runs
from tests.faults.figures import record as note
from tests.mutation import mutant

SEED = 14
MUTANTS = runs(10_000, 1_000_000)


def test_fault_14_mutated_records_raise_nothing_but_the_parsers_error() -> None:
    rng = random.Random(SEED)
    messages = [
        encode_message(26, CSI_CODE, encode_body(record(n_rx, n_tx, layout)))
        for layout in (20, 34, 38)
        for n_rx, n_tx in ((3, 1), (2, 2), (1, 3))
    ]
    refused = accepted = 0
    for number in range(MUTANTS):
        original = messages[number % len(messages)]
        # The headers decide what happens, so most mutations go there.
        changed = mutant(original[:60], rng) + original[60:] if rng.random() < 0.8 else mutant(original, rng)
        try:
            read = parse_body(*decode_message(changed, 26))
        except CsiError:
            refused += 1
        else:
            accepted += isinstance(read, CsiRecord)
    assert refused > MUTANTS // 10
    assert accepted > MUTANTS // 10
    note(14, "mutated records", mutants=MUTANTS, refused=refused, read_as_csi=accepted, other_errors=0)


def test_fault_14_a_mutated_log_loses_little_more_than_what_was_hit() -> None:
    rng = random.Random(SEED)
    good = [encode_file_record(CSI_CODE, encode_body(record(seed=number, frame_count=number))) for number in range(60)]
    good.insert(30, encode_file_record(MPDU_CODE, b"frame" * 9))
    rounds = runs(100, 10_000)
    lost = hit = 0
    for _ in range(rounds):
        at = rng.randrange(5, 55)
        log = b"".join([*good[:at], mutant(good[at], rng), *good[at + 1 :]])
        found = {record.frame_count for _, record in parsed(log) if isinstance(record, CsiRecord)}
        hit += 1
        lost += len(set(range(60)) - found)
    assert lost <= 2 * hit
    note(14, "mutated logs", damaged_records=hit, records_lost=lost)
