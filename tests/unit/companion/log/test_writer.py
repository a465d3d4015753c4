"""Messages into one file: the same bytes each time, readable wherever it is cut."""

from __future__ import annotations

from pathlib import Path

from companion.log.reader import LogScan
from companion.log.repair import repair
from companion.log.writer import LogWriter
from tests.unit.companion.log.written import METADATA_VALUES


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
