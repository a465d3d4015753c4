"""The log: what was recorded is read back, from whole and from cut files; files turn over, and a full queue drops."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import os
import queue
import random
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from companion.config.file import load_config
from companion.config.schema import Config
from companion.core.clock import ManualClock
from companion.core.event_clock import EventClock
from companion.core.inputs import Tick
from companion.core.messages import FlightMode, Pose, Setpoint, VehicleState, pose_bytes, pose_of
from companion.core.streams import (
    APERTURE,
    CSI,
    LOG,
    POSE,
    POSE_IN,
    PROFILE,
    SETPOINT,
    TARGET,
    TICK,
    VEHICLE,
    Stream,
)
from companion.errors import CompanionError, ConfigError
from companion.guidance.tracker import Target, TargetReport
from companion.log.foxglove import power_of
from companion.log.lines import LogLine
from companion.log.parts import open_part, parts_beside, remove_oldest
from companion.log.reader import LogScan, open_session, read_log
from companion.log.recorder import McapRecorder
from companion.sensing.records import ApertureRecord
from tests.paths import CONFIGS

CONFIG = load_config(CONFIGS / "uav.yaml")
POSE_AT = Pose(5, (1.0, -2.0, 0.5), (0.5, 0.5, -0.5, 0.5), (0.1, 0.2, 0.3), 3)


def setpoint(t_ns: int) -> Setpoint:
    return Setpoint(t_ns, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.5)


def settings(**changes: object) -> Config:
    return dataclasses.replace(CONFIG, recorder=dataclasses.replace(CONFIG.recorder, **changes))  # type: ignore[arg-type]


def clock() -> EventClock:
    return EventClock(ManualClock(1_000))


def write(path: Path, messages: int, config: Config = CONFIG) -> McapRecorder:
    own = clock()
    recorder = McapRecorder(path, config, own)
    for number in range(messages):
        with own.event(number):
            recorder.record(SETPOINT, number, setpoint(number))
            recorder.record(CSI, number, b"\xbb" + number.to_bytes(4, "little"))
    recorder.close()
    return recorder


def one_of_each(path: Path) -> None:
    recorder = McapRecorder(path, CONFIG, clock())
    chi = np.arange(6.0).reshape(2, 3)
    vehicle = VehicleState(t_mono_ns=7, mode=FlightMode.HOLD, p_local_enu_m=(1.0, 2.0, 3.0), yaw_enu_rad=1.0)
    aperture = ApertureRecord(
        number=3, peer=2, start_ns=10, end_ns=20, t_s=np.zeros(2).tobytes(), chi_m=chi.tobytes(),
        channel=np.ones(2, complex).tobytes(), wavelength_m=0.05, reference_p_m=(1.0, 0.0, 0.0),
    )  # fmt: skip
    power = np.linspace(0, 1, 180 * 360).astype(np.float16).tobytes()
    target = Target(9, 0.5, (1.0, 1.0, 1.0), 4, 6.0, 0.3)
    messages: tuple[tuple[Stream, object], ...] = (
        (POSE, POSE_AT),
        (POSE_IN, pose_bytes(POSE_AT)),
        (VEHICLE, vehicle),
        (APERTURE, aperture),
        (PROFILE, power),
        (TARGET, TargetReport(9, 2, 3, target, (2.0, 3.0, 4.0))),
        (TICK, Tick(4)),
        (LOG, LogLine(logging.WARNING, "companion.flight.loop", "something")),
    )
    for stream, message in messages:
        recorder.record(stream, 5, message)
    recorder.close()


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


def test_foxglove_messages_decode_with_the_schemas_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    one_of_each(path)
    decoded = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            if schema is not None and schema.encoding == "protobuf":
                (decoder,) = filter(None, [DecoderFactory().decoder_for(channel.message_encoding, schema)])
                decoded[channel.topic] = schema.name, decoder(message.data)
    assert {topic: name for topic, (name, _) in decoded.items()} == {
        "/pose": "foxglove.PoseInFrame",
        "/tf": "foxglove.FrameTransforms",
        "/aperture/path": "foxglove.PosesInFrame",
        "/aoa/profile": "foxglove.Grid",
        "/scene": "foxglove.SceneUpdate",
        "/log": "foxglove.Log",
    }
    assert decoded["/pose"][1].pose.position.y == -2.0
    turns = {turn.child_frame_id: turn.translation for turn in decoded["/tf"][1].transforms}
    assert turns["body"].z == 3.0
    # A viewer that shows `local` finds every other frame from it.
    shown = {decoded[topic][1].frame_id for topic in ("/pose", "/aperture/path", "/aoa/profile")}
    assert shown <= turns.keys()
    here = turns["tracker"]
    there = POSE_AT.p_enu_m
    assert (here.x + there[0], here.y + there[1], here.z + there[2]) == pytest.approx((1.0, 2.0, 3.0))
    assert [p.position.x for p in decoded["/aperture/path"][1].poses] == [1.0, 4.0]
    assert decoded["/log"][1].message == "something"
    profile = decoded["/aoa/profile"][1]
    assert (profile.column_count, len(profile.data)) == (360, 180 * 360)
    assert profile.data[-1] == 255
    (logged,) = read_log(path, {PROFILE.topic})
    np.testing.assert_allclose(power_of(logged.data).ravel(), np.linspace(0, 1, 180 * 360), atol=0.003)


def test_a_cut_file_gives_what_stands_before_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write(path, 4_000)
    whole = path.read_bytes()
    counts = []
    for size in [*range(200, len(whole), 2999), *range(len(whole) - 600, len(whole), 23)]:
        path.write_bytes(whole[:size])
        counts.append(len(read_log(path, {SETPOINT.topic})))
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == 4_000
    assert len(set(counts)) > 3


def test_a_file_that_cannot_be_written_or_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CompanionError, match="cannot write the log"):
        McapRecorder(tmp_path / "file" / "log.mcap", CONFIG, clock())
    with pytest.raises(CompanionError, match=r"/dev/full: cannot write the log: No space left"):
        McapRecorder(Path("/dev/full"), CONFIG, clock())
    with pytest.raises(CompanionError, match="cannot read the log"):
        read_log(tmp_path / "none.mcap", {"/x"})
    (tmp_path / "text.mcap").write_text("this is no log")
    with pytest.raises(CompanionError, match=r"not an MCAP log"):
        read_log(tmp_path / "text.mcap", {"/x"})
    with pytest.raises(CompanionError, match=r"not an MCAP log"):
        open_session(tmp_path / "text.mcap")


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


def test_the_budget_takes_the_oldest_finished_files_and_no_others(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    parts = [open_part(path, {}, "zstd", 65536) for _ in range(4)]
    stranger = tmp_path / "other.mcap"
    stranger.write_bytes(bytes(100_000))
    for part in (parts[0], parts[2], parts[3]):
        part.write(CSI, 1, 1, 1, os.urandom(10_000), 0.0)
        part.finish()
    # The first may go, the second is still being written, the third may go, the last is the newest finished one.
    newest = parts_beside(path)[-1].stat().st_size
    last = open_part(path, {}, "zstd", 65536)
    assert remove_oldest(path, newest + 1_000) == 2
    assert [p.name for p in parts_beside(path)] == ["log.1.mcap", "log.3.mcap", "log.4.mcap"]
    assert stranger.exists()
    parts[1].finish()
    last.finish()
    assert [p.name for p in parts_beside(path)] == ["log.1.mcap", "log.3.mcap", "log.4.mcap"]


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
    monkeypatch.setattr("companion.log.recorder._CHUNK_S", 0.2)
    recorder = McapRecorder(tmp_path / "log.mcap", CONFIG, clock())
    for number in range(3_000):
        recorder.record(CSI, number, b"\xbb" + number.to_bytes(4, "little") * 57)
    while recorder.counters()["queued"] or len(sizes := _chunk_sizes(tmp_path / "log.mcap")) < 3_000 * 260 >> 16:
        recorder._thread.join(0.01)  # full ones come at once
    assert all(64 << 10 <= size <= (64 << 10) + 400 for size in sizes)
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
