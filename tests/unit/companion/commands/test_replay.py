"""`companion replay`: of a log that is cut, with another configuration, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from companion.log.reader import open_session
from companion.log.writer import LogWriter
from tests.log_commands import FLIGHT, Run


def test_a_cut_log_replays_as_far_as_it_goes(companion: Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(FLIGHT.read_bytes()[:800_000])
    code, out, err = companion("replay", cut, "--check")
    assert code == 0, out + err
    assert "identical" in out


def test_what_cannot_be_replayed_says_why(companion: Run, tmp_path: Path) -> None:
    beacon = tmp_path / "beacon.mcap"
    metadata = dict(open_session(FLIGHT).metadata)
    config = json.loads(metadata["config"]) | {"role": "beacon"}
    with beacon.open("wb") as file:
        LogWriter(file, metadata | {"config": json.dumps(config)}).finish()
    code, _, err = companion("replay", beacon)
    assert code == 1
    assert "holds no decisions" in err
    code, _, err = companion("replay", FLIGHT, "--config", _config_file(tmp_path, config))
    assert code == 2
    assert "expected uav" in err
    with (tmp_path / "truth.mcap").open("wb") as file:
        LogWriter(file, {"role": "truth", "wall_minus_mono_ns": "0"}).finish()
    for command in ("replay", "report"):
        code, _, err = companion(command, tmp_path / "truth.mcap")
        assert code == 1
        assert "holds no configuration" in err
    (tmp_path / "cut.mcap").write_bytes(FLIGHT.read_bytes()[:100])
    code, _, err = companion("report", tmp_path / "cut.mcap")
    assert code == 1
    assert "cut off or damaged: its metadata" in err
    code, _, err = companion("replay", FLIGHT, "--speed", "-2")
    assert code == 2
    assert "positive factor" in err
    code, _, err = companion("replay", tmp_path / "none.mcap")
    assert code == 1
    assert len(err.strip().splitlines()) == 1


@pytest.mark.long
def test_another_configuration_is_set_beside_the_flown_one(companion: Run, tmp_path: Path) -> None:
    config = json.loads(open_session(FLIGHT).metadata["config"])
    config["aperture"]["estimator"] = "bartlett"
    other = tmp_path / "other.yaml"
    other.write_text(json.dumps(config))
    code, text, err = companion(
        "replay", FLIGHT, "--config", other, "--out", tmp_path / "o", "--json", tmp_path / "c.json"
    )
    assert code == 0, err
    rows = json.loads((tmp_path / "c.json").read_text())["comparison"]
    assert len(rows) >= 3
    moved = [row["moved_deg"] for row in rows if row["moved_deg"] is not None]
    assert moved and max(moved) <= 180
    assert any(deg > 0.01 for deg in moved)
    assert "open loop" in text
    assert (tmp_path / "o" / "comparison.png").read_bytes().startswith(b"\x89PNG")
    assert open_session(tmp_path / "o" / "replay.mcap").metadata["role"] == "replay"


def _config_file(folder: Path, config: dict[str, Any]) -> Path:
    path = folder / "config.yaml"
    path.write_text(json.dumps(config))
    return path
