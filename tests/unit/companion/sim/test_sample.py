"""The recording to try things with is one: analysed, it gives the bearing that it says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from companion.cli import program


@pytest.mark.parametrize(("seed", "card"), [(1, "5300"), (2, "5300"), (1, "ax210"), (3, "ax210")])
def test_a_sample_recording_gives_its_bearing(tmp_path: Path, seed: int, card: str) -> None:
    wanted = ["--recording", str(tmp_path / "run"), "--seed", str(seed), "--card", card]
    written = CliRunner().invoke(program, ["demo", *wanted])
    assert written.exit_code == 0, written.output
    found = re.search(r"azimuth (-?[\d.]+), elevation (-?[\d.]+) deg", written.output)
    assert found is not None
    result = tmp_path / "bearing.json"
    analysed = CliRunner().invoke(program, ["analyze", str(tmp_path / "run"), "--no-pictures", "--json", str(result)])
    assert analysed.exit_code == 0, analysed.output
    ((link,),) = (run["links"] for run in json.loads(result.read_text())["runs"])
    assert abs(link["azimuth_error_deg"]) < 3.0


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = CliRunner().invoke(program, ["demo", "--recording", str(tmp_path / "file" / "run")])
    assert result.exit_code != 0
