"""The recording to try things with is one: analysed, it gives the bearing that it says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from companion.cli import program
from companion.errors import CompanionError
from companion.sim.sample import write_sample


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


@pytest.mark.parametrize("name", ["groundtruth_positions.json", "csi_rx_2023-11-14_221320.dat", "csi_tx1_2021.dat"])
def test_a_users_own_files_stay_as_they_are(tmp_path: Path, name: str) -> None:
    own = tmp_path / name
    own.write_text("mine")
    result = CliRunner().invoke(program, ["demo", "--recording", str(tmp_path)])
    assert result.exit_code == 1
    assert name in str(result.exception)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert own.read_text() == "mine"


def test_two_cards_have_two_folders_and_a_recording_may_be_made_again(tmp_path: Path) -> None:
    for card, code in (("5300", 0), ("5300", 0), ("ax210", 1)):
        result = CliRunner().invoke(program, ["demo", "--recording", str(tmp_path), "--card", card])
        assert result.exit_code == code, result.output
    assert len(list(tmp_path.iterdir())) == 4


def test_on_a_full_disk_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, calls = Path.write_bytes, []

    def fail_late(path: Path, content: bytes) -> int:
        calls.append(path)
        if len(calls) == 2:
            write(path, content[:100])
            raise OSError(28, "No space left on device")
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", fail_late)
    with pytest.raises(CompanionError, match="No space left"):
        write_sample(tmp_path / "run", 1)
    assert not any(tmp_path.iterdir())
