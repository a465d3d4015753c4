"""`companion log info`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from companion.core.streams import CSI
from companion.errors import CompanionError
from companion.log.info import inspect
from companion.log.reader import open_session
from companion.log.repair import repair
from tests.log_commands import FLIGHT, Run
from tests.paths import FIELD_CASES
from tests.unit.companion.log.written import foreign


def test_info_tells_what_a_log_holds_and_that_one_is_cut(companion: Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(FLIGHT.read_bytes()[:400_000])
    code, out, _ = companion("log", "info", FLIGHT, cut, "--json", tmp_path / "info.json")
    assert code == 0
    assert "whole" in out
    assert "CUT OFF" in out
    whole, half = json.loads((tmp_path / "info.json").read_text())
    counts = {topic["topic"]: topic["messages"] for topic in whole["topics"]}
    assert counts["/csi"] == sum(1 for _ in open_session(FLIGHT).messages({CSI.topic}))
    assert 0 < sum(topic["messages"] for topic in half["topics"]) < sum(counts.values())
    assert (whole["is_whole"], half["is_whole"]) == (True, False)


@pytest.mark.parametrize("encoding", ["json", "cdr"])
@pytest.mark.parametrize("data", [b"[1]", b"null", b"\0\1\2", b'{"recorder": 3}', b"[" * 100_000])
def test_a_foreign_health_topic_is_shown_and_not_believed(tmp_path: Path, encoding: str, data: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(foreign(True, "/health", encoding, data))
    info = inspect(path)
    assert [topic.topic for topic in info.topics] == ["/health"]
    assert info.dropped == 0


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
