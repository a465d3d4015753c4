"""The log: what was recorded is read back, from whole and from cut files; files turn over, and a full queue drops."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import queue
import random
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import msgspec
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from companion.core.inputs import Tick
from companion.core.messages import Setpoint, pose_bytes, pose_of
from companion.core.streams import (
    CSI,
    POSE,
    PROFILE,
    SETPOINT,
    TICK,
)
from companion.errors import CompanionError, ConfigError
from companion.log import recorder as recorder_module
from companion.log.parts import parts_beside
from companion.log.reader import LogScan, open_session, read_log
from companion.log.recorder import McapRecorder
from tests.unit.companion.log.recorded import CONFIG, POSE_AT, clock, setpoint, settings, write


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    recorder = write(path, 500)
    assert (recorder.written, recorder.dropped, recorder.failures) == (1000, 0, 0)
    messages = read_log(path, {SETPOINT.topic, CSI.topic})
    setpoints = [msgspec.json.decode(m.data, type=Setpoint) for m in messages if m.topic == SETPOINT.topic]
    assert setpoints == [setpoint(number) for number in range(500)]
    assert messages[1].data == b"\xbb\0\0\0\0"
    assert [m.sequence for m in messages if m.topic == CSI.topic] == list(range(1, 501))
    session = open_session(path)
    assert messages[-1].log_time_ns - session.wall_minus_mono_ns == 499
    assert session.config() == CONFIG
    assert pose_of(pose_bytes(POSE_AT)) == POSE_AT


def test_the_plain_reader_finds_schemas_and_metadata(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write(path, 3)
    with path.open("rb") as file:
        reader = make_reader(file)
        schemas = {channel.topic: schema for schema, channel, _ in reader.iter_messages()}
        metadata = next(iter(reader.iter_metadata())).metadata
    schema = schemas[SETPOINT.topic]
    assert schema is not None
    assert schema.encoding == "jsonschema"
    assert "yaw_enu_rad" in msgspec.json.decode(schema.data)["properties"]
    assert msgspec.json.decode(metadata["config"])["name"] == CONFIG.name
    assert metadata["role"] == "uav"


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CompanionError, match="cannot write the log"):
        McapRecorder(tmp_path / "file" / "log.mcap", CONFIG, clock())
    with pytest.raises(CompanionError, match=r"/dev/full: cannot write the log: No space left"):
        McapRecorder(Path("/dev/full"), CONFIG, clock())


def test_a_message_that_cannot_be_encoded_costs_only_itself(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    recorder = McapRecorder(path, CONFIG, clock())
    recorder.record(PROFILE, 5, b"half a profile")
    recorder.record(POSE, 5, "no pose")
    recorder.record(TICK, 5, Tick(5))
    recorder.record(PROFILE, 5, bytes(2 * 180 * 360))  # nothing was heard: all zero
    recorder.close()
    assert recorder.counters() | {"queued": 0} == {
        "written": 2, "dropped": 2, "malformed": 2, "failures": 0, "queued": 0, "removed_files": 0,
    }  # fmt: skip
    assert [m.topic for m in read_log(path, {TICK.topic, PROFILE.topic})] == [TICK.topic, PROFILE.topic]


@pytest.mark.parametrize("whole_folder", [False, True])
def test_a_log_that_is_removed_is_begun_anew_and_what_it_held_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, whole_folder: bool
) -> None:
    monkeypatch.setattr(recorder_module, "_RETRY_S", 0.05)
    folder = tmp_path / "logs"
    folder.mkdir()
    path, end_s = folder / "log.mcap", time.monotonic() + 30
    recorder = McapRecorder(path, CONFIG, clock())
    for number in range(10):
        recorder.record(TICK, number, Tick(number))
    while recorder.written < 10 and time.monotonic() < end_s:
        time.sleep(0.01)
    shutil.rmtree(folder) if whole_folder else path.unlink()
    while not recorder.failures and time.monotonic() < end_s:
        time.sleep(0.01)
    assert recorder.failed or path.exists()
    folder.mkdir(exist_ok=True)
    while recorder.failed and time.monotonic() < end_s:
        time.sleep(0.01)
    recorder.record(TICK, 99, Tick(99))
    recorder.close()
    assert (recorder.written, recorder.dropped) == (1, 10)
    assert len(read_log(path, {TICK.topic})) == 1
    assert caplog.text.count("the log was removed") == 1


def test_a_log_that_is_there_is_never_touched(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write(path, 10)
    before = path.read_bytes()
    write(path, 1)
    write(path, 1)
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.1.mcap", "log.2.mcap", "log.mcap"]
    assert len(open_session(path).paths) == 1  # each is a recording of its own


def test_files_turn_over_and_read_as_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.log.recorder._CHUNK_S", 0.1)
    path = tmp_path / "log.mcap"
    own = clock()
    recorder = McapRecorder(path, settings(rotate_s=0.2, compression="lz4"), own)
    total = 0
    while len(parts_beside(path)) < 3:
        with own.event(total):
            recorder.record(SETPOINT, total, setpoint(total))
        total += 1
        recorder._thread.join(0.005)
    recorder.close()
    assert all(_is_whole(part) for part in parts_beside(path))
    for part in parts_beside(path):
        session = open_session(part)
        assert session.paths == tuple(parts_beside(path))
    times = [m.log_time_ns - session.wall_minus_mono_ns for m in session.messages({SETPOINT.topic})]
    assert times == list(range(total))
    path.unlink()
    assert open_session(tmp_path / "log.2.mcap").missing_parts == 1
    (tmp_path / "log.1.mcap").rename(tmp_path / "elsewhere.mcap")
    assert open_session(tmp_path / "log.2.mcap").missing_parts == 2


def test_the_budget_holds_at_every_moment_and_every_file_keeps_its_size(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    recorder = McapRecorder(path, settings(rotate_mb=2.0, budget_mb=5.0, queue_messages=100), clock())
    most = 0
    for number in range(7_000):
        recorder.record(CSI, number, b"\xbb" + random.Random(number).randbytes(1_500))
        while recorder.counters()["queued"] > 50:
            sizes = _sizes(path)
            most = max(most, sum(sizes))
            assert max(sizes) <= 2_000_000
            recorder._thread.join(0.001)
    recorder.close()
    assert recorder.dropped == 0
    assert recorder.removed_files >= 3
    assert 3_000_000 < max(most, sum(_sizes(path))) <= 5_000_000
    assert all(_is_whole(part) and part.stat().st_size <= 2_000_000 for part in parts_beside(path))


def test_a_chunk_ends_when_it_is_full_or_its_oldest_message_is_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.log.recorder._CHUNK_S", 1e3)
    recorder = McapRecorder(tmp_path / "log.mcap", CONFIG, clock())
    for number in range(3_000):
        recorder.record(CSI, number, b"\xbb" + number.to_bytes(4, "little") * 57)
    while recorder.counters()["queued"] or len(sizes := _chunk_sizes(tmp_path / "log.mcap")) < 3_000 * 260 >> 16:
        recorder._thread.join(0.01)  # full ones come at once
    assert all(64 << 10 <= size <= (64 << 10) + 400 for size in sizes)
    monkeypatch.setattr("companion.log.recorder._CHUNK_S", 0.2)
    recorder.record(TICK, 1, Tick(1))
    while not read_log(tmp_path / "log.mcap", {TICK.topic}):  # without any more coming
        recorder._thread.join(0.01)
    recorder.close()
    assert sum(_chunk_sizes(tmp_path / "log.mcap")) > 3_000 * 260


@pytest.mark.parametrize("since_sync_s", [0.0, 1e3])
def test_a_chunk_goes_to_the_disk_unless_the_next_is_within_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, since_sync_s: float
) -> None:
    """`since_sync_s`: after so long a chunk is synced."""
    monkeypatch.setattr("companion.log.recorder._SYNC_S", 0.85 + since_sync_s)
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_size))
    recorder = McapRecorder(tmp_path / "log.mcap", CONFIG, clock())
    for number in range(1_000):
        recorder.record(CSI, number, b"\xbb" + number.to_bytes(4, "little") * 57)
    recorder.close()
    chunks = _chunk_sizes(tmp_path / "log.mcap")
    assert len(chunks) == 4
    full = 0 if since_sync_s else 3  # the last one is synced with the index
    assert len(synced) == full + 1
    assert synced == sorted(set(synced))
    assert synced[-1] == (tmp_path / "log.mcap").stat().st_size


def test_a_chunk_that_none_follows_goes_to_the_disk_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.log.recorder._SYNC_S", 0.9)
    synced = queue.Queue[int]()
    monkeypatch.setattr(os, "fsync", lambda file: synced.put(os.fstat(file).st_size))
    recorder = McapRecorder(tmp_path / "log.mcap", CONFIG, clock())
    recorder.record(CSI, 1, b"\xbb" + os.urandom(100_000))  # a chunk of its own, right behind the start
    assert synced.get(timeout=10) > 100_000
    recorder.close()


def _sizes(path: Path) -> list[int]:
    """Of all files of a recording; one that is removed meanwhile is none."""
    sizes = []
    for part in parts_beside(path):
        with contextlib.suppress(FileNotFoundError):
            sizes.append(part.stat().st_size)
    return sizes


def _chunk_sizes(path: Path) -> list[int]:
    """Before compression."""
    with path.open("rb") as file:
        return [record.uncompressed_size for record in _chunks(file)]


def _chunks(file: BinaryIO) -> Iterator[Chunk]:
    try:
        yield from (record for record in StreamReader(file, emit_chunks=True).records if isinstance(record, Chunk))
    except EndOfFile:
        return


def _is_whole(path: Path) -> bool:
    scan = LogScan(path)
    for _ in scan:
        pass
    return scan.is_whole


@pytest.mark.parametrize(
    ("name", "said"), [("absent/log.mcap", "there is no folder"), (".", "a folder; expected a file")]
)
def test_a_place_that_cannot_be_meant_is_refused(tmp_path: Path, name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=f"recorder.path .*{said}"):
        write(tmp_path / name, 1)
    assert list(tmp_path.iterdir()) == []


def test_the_services_own_directory_is_made(tmp_path: Path) -> None:
    own = dataclasses.replace(CONFIG, runtime_dir=str(tmp_path / "run" / "companion"))
    write(own.path("log.mcap"), 1, own)
    assert own.path("log.mcap").exists()
