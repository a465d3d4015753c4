"""Damage costs what it touched: a flipped byte at most the record it is in, lost bytes at the start no flight."""

from __future__ import annotations

import io
import random
import struct
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from companion.core.streams import CSI
from companion.errors import CompanionError
from companion.log.info import inspect
from companion.log.reader import LogScan, metadata_of, open_session
from companion.log.repair import copy, repair
from companion.log.scan import RecordScan
from companion.log.writer import CHECKSUM, METADATA, LogWriter
from tests.golden.golden_logs import GOLDEN
from tests.paths import FIELD_CASES

METADATA_VALUES = {"role": "uav", "name": "uav", "config": '{"a": 1}' * 300, "session": "s", "wall_minus_mono_ns": "5"}
_HEAD = struct.Struct("<BQ")


def log_of(messages: int = 4000, compression: Any = "zstd") -> bytes:
    """A log of this program of some twenty chunks."""
    file = io.BytesIO()
    writer = LogWriter(file, METADATA_VALUES, compression, chunk_bytes=16 << 10)
    chance = random.Random(0)
    for number in range(messages):
        writer.write(CSI, number, number, number, chance.randbytes(60) + number.to_bytes(4, "little"))
    writer.finish()
    return file.getvalue()


def frames(content: bytes | bytearray) -> list[tuple[int, int, int]]:
    """(code, begin, end) of each record."""
    found, at = [], 8
    while at < len(content) - 8:
        code, length = _HEAD.unpack_from(content, at)
        found.append((code, at, at + 9 + length))
        at += 9 + length
    return found


def numbers(path: Path) -> list[int]:
    return [int.from_bytes(message.data[-4:], "little") for message in LogScan(path)]


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_any_byte_of_a_chunks_head_costs_that_chunk_alone(tmp_path: Path, compression: str) -> None:
    content = log_of(compression=compression)
    chunks = [frame for frame in frames(content) if frame[0] == Opcode.CHUNK]
    _, begin, end = chunks[5]
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    all_numbers = set(numbers(path))
    each = len(all_numbers) // len(chunks)
    places = [*range(begin, begin + 9 + 44 + len(compression) - 4 + 8), *range(begin + 80, end, 997)]
    for place in places:
        for flip in (0x01, 0x80) if place % 3 else (0x41,):
            hurt = bytearray(content)
            hurt[place] ^= flip
            path.write_bytes(hurt)
            scan = LogScan(path)
            left = {int.from_bytes(message.data[-4:], "little") for message in scan}
            assert left <= all_numbers
            missing = len(all_numbers) - len(left)
            assert missing <= each * 1.2, (place - begin, flip, missing)
            # The times of a chunk are for its index alone, which nobody here reads.
            assert missing == 0 or (scan.damaged == 1 and not scan.is_whole), (place - begin, flip)


def test_one_flipped_byte_anywhere_is_no_traceback_and_costs_little(tmp_path: Path) -> None:
    content = log_of()
    chance = random.Random(2)
    path, target = tmp_path / "log.mcap", tmp_path / "saved.mcap"
    for _ in range(30):
        hurt = bytearray(content)
        hurt[chance.randrange(8, len(hurt))] ^= 1 << chance.randrange(8)
        path.write_bytes(hurt)
        saved = repair(path, target)
        assert saved.messages >= 3500
        assert saved.is_replayable
        assert metadata_of(target)[METADATA] == METADATA_VALUES
        assert LogScan(target).path == target
        target.unlink()


@pytest.mark.parametrize("how", ["zeroed", "gone", "noise"])
def test_lost_bytes_at_the_start_cost_neither_configuration_nor_clock(tmp_path: Path, how: str) -> None:
    content = log_of()
    lost = {"zeroed": bytes(512), "gone": b"", "noise": random.Random(3).randbytes(512)}[how]
    path = tmp_path / "log.mcap"
    path.write_bytes(lost + content[512:])
    session = open_session(path)
    assert session.metadata == METADATA_VALUES
    assert session.wall_minus_mono_ns == 5
    assert numbers(path) == list(range(4000))
    assert not inspect(path).is_whole
    saved = repair(path, tmp_path / "saved.mcap")
    assert (saved.messages, saved.damaged, saved.is_replayable) == (4000, 1, True)
    assert saved.lost_bytes > 400


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


def test_what_a_chunk_claims_to_hold_is_bounded(tmp_path: Path) -> None:
    """A claimed size of exabytes, and a few bytes that unpack to far more than they claim."""
    content = log_of(100)
    _, begin, end = next(frame for frame in frames(content) if frame[0] == Opcode.CHUNK)
    claimed = bytearray(content)
    claimed[begin + 9 + 16 : begin + 9 + 24] = b"\xff" * 8
    bomb = lz4.frame.compress(bytes(64 << 20))
    body = struct.pack("<QQQI", 0, 0, 1000, 0) + b"\3\0\0\0lz4" + struct.pack("<Q", len(bomb)) + bomb
    packed = content[:begin] + _HEAD.pack(Opcode.CHUNK, len(body)) + body + content[end:]
    for bad in (bytes(claimed), packed):
        path = tmp_path / "log.mcap"
        path.write_bytes(bad)
        scan = LogScan(path)
        assert list(scan) == []
        assert scan.damaged == 1


@pytest.mark.parametrize("crc", [True, False])
def test_unknown_compression_is_named(tmp_path: Path, crc: bool) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(_foreign(crc).replace(b"\4\0\0\0zstd", b"\4\0\0\0bz2x"))
    for job in (lambda: inspect(path), lambda: repair(path, tmp_path / "out.mcap")):
        with pytest.raises(CompanionError, match=r"compression 'bz2x' is not known; expected zstd, lz4 or none"):
            job()
    assert not (tmp_path / "out.mcap").exists()


def test_repair_refuses_what_another_program_wrote(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(_foreign(True))
    with pytest.raises(CompanionError, match="no log of this program"):
        repair(path, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_a_failed_repair_leaves_no_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(log_of(100))

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("companion.log.repair.copy", fail)
    with pytest.raises(CompanionError, match="No space left"):
        repair(path, tmp_path / "out.mcap")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("encoding", ["json", "cdr"])
@pytest.mark.parametrize("data", [b"[1]", b"null", b"\0\1\2", b'{"recorder": 3}', b"[" * 100_000])
def test_a_foreign_health_topic_is_shown_and_not_believed(tmp_path: Path, encoding: str, data: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(_foreign(True, "/health", encoding, data))
    info = inspect(path)
    assert [topic.topic for topic in info.topics] == ["/health"]
    assert info.dropped == 0


def test_two_encodings_of_one_topic_stay_apart(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = LogWriter(file, METADATA_VALUES)
        writer.copy("/p", "json", ("Pose", "jsonschema", b"{}"), (1, 1), 0, b"{}")
        writer.copy("/p", "cdr", ("Pose", "ros2msg", b"x"), (2, 2), 0, b"\0")
        writer.finish()
    repair(path, tmp_path / "out.mcap")
    assert [(m.encoding, m.schema) for m in LogScan(tmp_path / "out.mcap")] == [
        ("json", ("Pose", "jsonschema", b"{}")),
        ("cdr", ("Pose", "ros2msg", b"x")),
    ]


def test_a_whole_file_is_whole_and_a_changed_index_is_not(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    content = bytearray(log_of(100))
    path.write_bytes(content)
    scan = LogScan(path)
    assert len(list(scan)) == 100
    assert scan.is_whole
    _, begin, _ = next(frame for frame in frames(content) if frame[0] == Opcode.STATISTICS)
    content[begin + 9] ^= 1
    path.write_bytes(content)
    scan = LogScan(path)
    assert len(list(scan)) == 100
    assert (scan.is_whole, scan.damaged) == (False, 1)


@pytest.mark.skipif(not FIELD_CASES.is_dir(), reason="no field cases beside this clone")
@pytest.mark.parametrize("path", sorted(FIELD_CASES.glob("mcap-*/*.mcap")), ids=lambda path: path.name)
def test_field_cases_are_shown_or_named(path: Path, tmp_path: Path) -> None:
    if "compression" in str(path):
        with pytest.raises(CompanionError, match="compression 'bz2' is not known"):
            inspect(path)
    else:
        assert inspect(path).is_whole
    with pytest.raises(CompanionError):
        repair(path, tmp_path / "out.mcap")
    assert list(tmp_path.iterdir()) == []


def test_records_that_are_only_skipped_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(log_of(4000))
    with path.open("rb") as file:
        scan = RecordScan(file, passed_over=(Opcode.CHUNK,))
        kinds = {type(record).__name__ for record in scan}
    assert "Message" not in kinds
    assert "Metadata" in kinds
    assert scan.is_whole


def _foreign(crc: bool, topic: str = "/a", encoding: str = "json", data: bytes = b"{}") -> bytes:
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD, enable_crcs=crc)
    writer.start(profile="ros2", library="other")
    schema = writer.register_schema("H", "jsonschema", b"{}")
    channel = writer.register_channel(topic, encoding, schema, {"qos": "x"})
    writer.add_message(channel, 1, data, 1)
    writer.add_attachment(0, 0, "a.txt", "text/plain", b"abc")
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()
