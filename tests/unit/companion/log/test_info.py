"""`companion log info`."""

from __future__ import annotations

import json
from pathlib import Path

from companion.core.streams import CSI
from companion.log.reader import open_session
from tests.log_commands import FLIGHT, Run


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
