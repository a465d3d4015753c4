"""Logs are read as far as they go, and what cannot be read is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from companion.core.streams import SETPOINT
from companion.errors import CompanionError
from companion.log.reader import LogScan, metadata_of, open_session, read_log
from companion.log.repair import copy, repair
from companion.log.writer import CHECKSUM, METADATA, LogWriter
from tests.golden.golden_logs import GOLDEN
from tests.unit.companion.log.recorded import write
from tests.unit.companion.log.written import METADATA_VALUES, frames, log_of


def test_a_cut_file_gives_what_stands_before_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write(path, 4_000)
    whole = path.read_bytes()
    counts = []
    for size in [*range(200, len(whole), 7919), *range(len(whole) - 600, len(whole), 47)]:
        path.write_bytes(whole[:size])
        counts.append(len(read_log(path, {SETPOINT.topic})))
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == 4_000
    assert len(set(counts)) > 3


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(CompanionError, match="cannot read the log"):
        read_log(tmp_path / "none.mcap", {"/x"})
    (tmp_path / "text.mcap").write_text("this is no log")
    with pytest.raises(CompanionError, match=r"not an MCAP log"):
        read_log(tmp_path / "text.mcap", {"/x"})
    with pytest.raises(CompanionError, match=r"not an MCAP log"):
        open_session(tmp_path / "text.mcap")


def test_the_golden_flight_is_replayable_without_its_first_bytes(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = LogWriter(file, open_session(GOLDEN[0]).metadata)
        for message in LogScan(GOLDEN[0]):
            copy(writer, message)
        writer.finish()
    content = path.read_bytes()
    path.write_bytes(bytes(512) + content[512:])
    session, golden = open_session(path), open_session(GOLDEN[0])
    assert session.config() == golden.config()
    assert [m.data for m in session.messages()] == [m.data for m in golden.messages()]


def test_a_log_of_a_newer_version_says_which_one_reads_it() -> None:
    session = open_session(GOLDEN[0])
    config = json.loads(session.metadata["config"]) | {"laser": {"enabled": True}}
    newer = replace(session, metadata={**session.metadata, "config": json.dumps(config), "version": "9.1.0"})
    with pytest.raises(CompanionError, match="laser: unknown key") as refused:
        newer.config()
    assert "recorded by version 9.1.0, which reads it; this is " in str(refused.value)
    assert refused.value.exit_code == 1, "it is the log's configuration, not the user's"


def test_metadata_stand_at_intervals_and_a_damaged_copy_is_not_taken(tmp_path: Path) -> None:
    content = bytearray(log_of(8000))
    copies = [frame for frame in frames(content) if frame[0] == Opcode.METADATA]
    assert len(copies) >= 4
    content[copies[0][1] + 100] ^= 1  # a letter of its text: nothing but the checksum shows it
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    assert metadata_of(path)[METADATA] == METADATA_VALUES
    assert CHECKSUM not in metadata_of(path)[METADATA]


def test_a_log_that_lost_all_its_metadata_says_so(tmp_path: Path) -> None:
    content = bytearray(log_of(100))
    for code, begin, _ in frames(content):
        if code == Opcode.METADATA:
            content[begin + 9 + 60] ^= 1
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    saved = repair(path, tmp_path / "saved.mcap")
    assert (saved.messages, saved.is_replayable) == (100, False)
    with pytest.raises(CompanionError, match="its metadata 'companion' cannot be read"):
        open_session(path)
