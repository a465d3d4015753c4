"""Messages into one file: the same bytes each time, readable wherever it is cut."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.core.messages import VehicleState
from companion.core.streams import CSI, TRANSFORMS, VEHICLE
from companion.log.reader import LogScan
from companion.log.repair import repair
from companion.log.writer import CHECKSUM, Compression, LogWriter, checksum_of
from tests.unit.companion.log.written import METADATA_VALUES


def test_two_encodings_of_one_topic_stay_apart(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = LogWriter(file, METADATA_VALUES)
        writer.copy("/p", "json", ("Pose", "jsonschema", b"{}"), (1, 1), sequence=0, data=b"{}")
        writer.copy("/p", "cdr", ("Pose", "ros2msg", b"x"), (2, 2), sequence=0, data=b"\0")
        writer.finish()
    repair(path, tmp_path / "out.mcap")
    assert [(m.encoding, m.schema) for m in LogScan(tmp_path / "out.mcap")] == [
        ("json", ("Pose", "jsonschema", b"{}")),
        ("cdr", ("Pose", "ros2msg", b"x")),
    ]


def _written(path: Path, compression: Compression = "zstd", count: int = 400) -> LogWriter:
    with path.open("wb") as file:
        writer = LogWriter(file, METADATA_VALUES, compression, chunk_bytes=4 << 10)
        for number in range(count):
            writer.write(CSI, 2 * number, number, number, message=number.to_bytes(4, "little") * 30)
        writer.finish()
    return writer


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_messages_come_back_with_their_times_and_are_the_same_bytes_each_time(
    tmp_path: Path, compression: Compression
) -> None:
    first, second = tmp_path / "a.mcap", tmp_path / "b.mcap"
    for path in (first, second):
        _written(path, compression)
    assert first.read_bytes() == second.read_bytes()
    found = list(LogScan(first))
    assert [message.data[:4] for message in found] == [n.to_bytes(4, "little") for n in range(400)]
    assert [(m.log_time_ns, m.publish_time_ns, m.sequence) for m in found[:3]] == [(0, 0, 0), (2, 1, 1), (4, 2, 2)]


def test_views_stand_beside_the_message_they_are_drawn_from(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = LogWriter(file, METADATA_VALUES)
        writer.write(
            VEHICLE, 9, 9, 4, message=VehicleState(t_mono_ns=7, p_local_enu_m=(1.0, 2.0, 1.5), yaw_enu_rad=0.3)
        )
        writer.finish()
    assert [(one.topic, one.sequence) for one in LogScan(path)] == [(VEHICLE.topic, 4), (TRANSFORMS.topic, 4)]


def test_a_chunk_that_ends_early_is_in_the_file_and_an_empty_one_is_none(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = LogWriter(file, METADATA_VALUES)
        writer.end_chunk()
        assert writer.chunks == 0
        writer.write(CSI, 1, 1, 1, message=b"\xbb")
        assert writer.open_bytes > 0
        writer.end_chunk()
        assert (writer.chunks, writer.open_bytes) == (1, 0)
        file.flush()
        assert [one.data for one in LogScan(path)] == [b"\xbb"], "whoever reads now finds it"
        writer.finish()


def test_a_checksum_is_of_keys_and_values_whatever_their_order() -> None:
    assert checksum_of({"a": "1", "b": "2"}) == checksum_of({"b": "2", "a": "1"})
    assert checksum_of({"a": "1", "b": "2"}) != checksum_of({"a": "2", "b": "1"})
    assert checksum_of({"a": "1", CHECKSUM: "anything"}) == checksum_of({"a": "1"})


@pytest.mark.parametrize("count", [0, 3, 400])
def test_the_end_of_a_log_is_no_longer_than_was_told(tmp_path: Path, count: int) -> None:
    """By which a part of a log keeps within its size: the index and one more copy of all metadata."""
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = LogWriter(file, METADATA_VALUES | {"config": "x" * 4000})
        writer.add_metadata("another", {"key": "value" * 100})
        for number in range(count):
            writer.write(VEHICLE, number, number, number, message=VehicleState(t_mono_ns=number))
        writer.end_chunk()
        before, told = file.tell(), writer.index_bytes
        writer.finish()
        assert file.tell() - before <= told < file.tell() - before + 6000
