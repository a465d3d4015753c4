"""The log: what was recorded is read back, from whole and from cut files, and a full queue drops without blocking."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from companion.errors import CompanionError
from companion.log_reader import read_log
from companion.messages import Setpoint
from companion.recorder import Recorder
from companion.streams import CSI, SETPOINT, STREAMS


@dataclass(frozen=True)
class Settings:
    name: str


def setpoint(t_ns: int) -> Setpoint:
    return Setpoint(t_ns, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.5)


def write(path: Path, messages: int) -> Recorder:
    recorder = Recorder(path, Settings("uav"), "1.2.3", queue_messages=100_000)
    for number in range(messages):
        recorder.record(SETPOINT, number, setpoint(number))
        recorder.record(CSI, number, b"\xbb" + number.to_bytes(4, "little"))
    recorder.close()
    return recorder


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "log.mcap"
    recorder = write(path, 500)
    assert (recorder.written, recorder.dropped) == (1000, 0)
    messages = read_log(path, {SETPOINT.topic, CSI.topic})
    setpoints = [msgspec.json.decode(m.data, type=Setpoint) for m in messages if m.topic == SETPOINT.topic]
    assert setpoints == [setpoint(number) for number in range(500)]
    assert messages[1].data == b"\xbb\0\0\0\0"
    assert read_log(path, {SETPOINT.topic})[0].topic == SETPOINT.topic


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
    assert metadata["version"] == "1.2.3"
    assert msgspec.json.decode(metadata["config"]) == {"name": "uav"}


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
        Recorder(tmp_path / "file" / "log.mcap", Settings(""), "1", 100)
    with pytest.raises(CompanionError, match="cannot read the log"):
        read_log(tmp_path / "none.mcap", {"/x"})
    (tmp_path / "text.mcap").write_text("this is no log")
    with pytest.raises(CompanionError, match=r"not a readable MCAP log"):
        read_log(tmp_path / "text.mcap", {"/x"})


def test_a_log_that_is_there_is_never_touched(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write(path, 10)
    before = path.read_bytes()
    write(path, 1)
    write(path, 1)
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.1.mcap", "log.2.mcap", "log.mcap"]


def test_a_full_disk_stops_the_log_and_not_the_caller() -> None:
    recorder = Recorder(Path("/dev/full"), Settings(""), "1", queue_messages=200)
    for number in range(20_000):
        recorder.record(CSI, number, bytes(500))
    recorder.close()
    assert recorder.failed
    assert recorder.dropped > 0


def test_every_stream_has_a_topic_of_its_own() -> None:
    topics = [stream.topic for stream in STREAMS]
    assert len(set(topics)) == len(topics)
