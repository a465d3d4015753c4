"""Damage costs what it touched: a flipped byte at most the record it is in, lost bytes at the start no flight."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import lz4.frame
import pytest
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from companion.errors import CompanionError
from companion.log.info import inspect
from companion.log.reader import LogScan, metadata_of, open_session
from companion.log.repair import repair
from companion.log.scan import RecordScan
from companion.log.writer import METADATA
from tests.log_commands import FLIGHT, Run
from tests.unit.companion.log.written import HEAD, METADATA_VALUES, foreign, frames, log_of


def numbers(path: Path) -> list[int]:
    return [int.from_bytes(message.data[-4:], "little") for message in LogScan(path)]


@pytest.mark.parametrize("compression", ["zstd", pytest.param("lz4", marks=pytest.mark.long)])
def test_any_byte_of_a_chunks_head_costs_that_chunk_alone(tmp_path: Path, compression: str) -> None:
    content = log_of(1000, compression, 4 << 10)
    chunks = [frame for frame in frames(content) if frame[0] == Opcode.CHUNK]
    _, begin, end = chunks[5]
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    all_numbers = set(numbers(path))
    each = len(all_numbers) // len(chunks)
    places = [*range(begin, begin + 9 + 44 + len(compression) - 4 + 8), *range(begin + 80, end, 749)]
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
    content = log_of(1000, chunk_bytes=4 << 10)
    chance = random.Random(2)
    path, target = tmp_path / "log.mcap", tmp_path / "saved.mcap"
    for _ in range(30):
        hurt = bytearray(content)
        hurt[chance.randrange(8, len(hurt))] ^= 1 << chance.randrange(8)
        path.write_bytes(hurt)
        saved = repair(path, target)
        assert saved.messages >= 875
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


def test_what_a_chunk_claims_to_hold_is_bounded(tmp_path: Path) -> None:
    """A claimed size of exabytes, and a few bytes that unpack to far more than they claim."""
    content = log_of(100)
    _, begin, end = next(frame for frame in frames(content) if frame[0] == Opcode.CHUNK)
    claimed = bytearray(content)
    claimed[begin + 9 + 16 : begin + 9 + 24] = b"\xff" * 8
    bomb = lz4.frame.compress(bytes(64 << 20))
    body = struct.pack("<QQQI", 0, 0, 1000, 0) + b"\3\0\0\0lz4" + struct.pack("<Q", len(bomb)) + bomb
    packed = content[:begin] + HEAD.pack(Opcode.CHUNK, len(body)) + body + content[end:]
    for bad in (bytes(claimed), packed):
        path = tmp_path / "log.mcap"
        path.write_bytes(bad)
        scan = LogScan(path)
        assert list(scan) == []
        assert scan.damaged == 1


@pytest.mark.parametrize("crc", [True, False])
def test_unknown_compression_is_named(tmp_path: Path, crc: bool) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(foreign(crc).replace(b"\4\0\0\0zstd", b"\4\0\0\0bz2x"))
    for job in (lambda: inspect(path), lambda: repair(path, tmp_path / "out.mcap")):
        with pytest.raises(CompanionError, match=r"compression 'bz2x' is not known; expected zstd, lz4 or none"):
            job()
    assert not (tmp_path / "out.mcap").exists()


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


def test_records_that_are_only_skipped_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(log_of(4000))
    with path.open("rb") as file:
        scan = RecordScan(file, passed_over=(Opcode.CHUNK,))
        kinds = {type(record).__name__ for record in scan}
    assert "Message" not in kinds
    assert "Metadata" in kinds
    assert scan.is_whole


def test_a_chunk_of_zeros_is_no_hundred_thousand_records(tmp_path: Path) -> None:
    path = tmp_path / "zeros.mcap"
    data = bytes(900_000)
    chunk = struct.pack("<QQQIIQ", 0, 1, len(data), 0, 0, len(data)) + data
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", Opcode.CHUNK, len(chunk)) + chunk)
    with path.open("rb") as file:
        scan = RecordScan(file)
        assert list(scan) == [] and not scan.is_whole and scan.chunks == 0


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"#ROSBAG V2.0\n", "a rosbag of ROS 1"),
        (b"ULog\x01\x12\x35", "a ULog of PX4"),
        (b"hello, there\n", "it begins with b'hello, t'"),
    ],
)
def test_another_programs_file_is_named(tmp_path: Path, content: bytes, named: str) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content + bytes(100) * (b"," not in content))
    for read in (inspect, open_session, lambda one: repair(one, tmp_path / "saved.mcap")):
        with pytest.raises(CompanionError, match=rf"log\.mcap: not an MCAP log: {named}"):
            read(path)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"\x89MC"])
def test_a_repair_that_saves_nothing_fails_and_leaves_nothing(tmp_path: Path, content: bytes) -> None:
    path, target = tmp_path / "log.mcap", tmp_path / "saved.mcap"
    path.write_bytes(content)
    with pytest.raises(CompanionError, match="nothing could be saved"):
        repair(path, target)
    assert not target.exists()


def test_another_log_behind_a_log_is_named_and_nothing_is_done_without_it(companion: Run, tmp_path: Path) -> None:
    joined = tmp_path / "joined.mcap"
    first, second = FLIGHT.read_bytes(), log_of(100)
    for begun in (first, first[:700_000], first[:700_003]):
        joined.write_bytes(begun + second)
        code, out, _ = companion("log", "info", joined)
        assert code == 0
        assert f"another log begins at byte {len(begun)}" in " ".join(out.split())
        for words in (("log", "repair"), ("log", "export", "--out", tmp_path / "o"), ("report", "-o", tmp_path / "r")):
            code, out, err = companion(*words, joined)
            assert code == 1, (words, out)
            assert f"another log begins at byte {len(begun)}" in err
        assert list(tmp_path.iterdir()) == [joined]
    code, _, err = companion("replay", "--check", joined)
    assert code == 1
    assert "another log begins" in err


def test_the_magic_in_a_message_is_no_other_log(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(foreign(True, data=MCAP0_MAGIC + b"\x01" + bytes(50)))
    scan = LogScan(path)
    assert len(list(scan)) == 1
    assert scan.is_whole
    assert scan.another_at is None


@pytest.mark.parametrize(("old", "new"), [(b"\n", b"\r\n"), (b"\r\n", b"\n"), (b"\n", b"\r")])
def test_a_transfer_in_text_mode_is_named(companion: Run, tmp_path: Path, old: bytes, new: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(FLIGHT.read_bytes().replace(old, new))
    for words in (("log", "info"), ("log", "repair"), ("log", "export", "--out", tmp_path / "o"), ("replay",)):
        code, out, err = companion(*words, path)
        assert code == 1, (words, out)
        assert "copy it again, in binary mode" in err
    assert list(tmp_path.iterdir()) == [path]


def test_an_empty_log_is_said_to_be_empty(companion: Run, tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(b"")
    code, out, _ = companion("log", "info", tmp_path / "log.mcap")
    assert code == 0 and "empty; nothing" in out
    for words in (("log", "repair"), ("report",)):
        code, _, err = companion(*words, tmp_path / "log.mcap")
        assert code == 1, words
        assert "empty; nothing was written to it" in err
