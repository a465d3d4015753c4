"""`companion evaluate`: what it counts, tells and refuses, on runs of known truth and on recorded ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from companion.analysis.evaluation import ALL, trust
from companion.cli import program
from companion.commands.evaluate import _trust_line
from companion.errors import CompanionError
from tests import paths
from tests.link_rows import row
from tests.synthetic_run import write_run

DATA = paths.DATA / "wsr_dataset_dev"


def evaluate(*arguments: object) -> Result:
    return CliRunner().invoke(program, ["evaluate", *map(str, arguments)], catch_exceptions=True)


def test_a_link_that_has_files_but_no_estimate_counts_as_180_degrees(tmp_path: Path) -> None:
    write_run(tmp_path / "Set_X" / "L1", (4.0, 1.0, 0.8))
    bad = write_run(tmp_path / "Set_X" / "L2", (4.0, 1.0, 0.8))
    bad.tx.write_bytes(b"")
    gone = write_run(tmp_path / "Set_Y" / "L3", (4.0, 1.0, 0.8))
    gone.trajectory.unlink()
    done = evaluate(
        tmp_path, "--estimator", "bartlett", "--jobs", 2, "--json", tmp_path / "r.json", "--out", tmp_path / "p"
    )
    assert done.exit_code == 0, done.output
    result: dict[str, Any] = json.loads((tmp_path / "r.json").read_text())
    assert result["sets"]["Set_X"]["n"] == 2
    errors = {link["position"]: link["error_deg"] for link in result["links"]}
    assert errors["L1"] < 5
    assert errors["L2"] == 180
    assert "Set_Y" not in result["sets"]
    assert any("trajectory" in entry["reason"] for entry in result["left_out"])
    assert {path.suffix for path in (tmp_path / "p").iterdir()} == {".png"}


def test_what_is_wrong_with_a_run_that_is_evaluated_is_told(tmp_path: Path) -> None:
    run = write_run(tmp_path / "Set_X" / "L1", (4.0, 1.0, 0.8))
    rows = run.trajectory.read_text().splitlines(keepends=True)
    far = [",".join([*fields[:2], str(float(fields[2]) + n / 1e3), *fields[3:]]) for n, fields in _numbered(rows)]
    (run.folder / f"t265_{run.trajectory.name}").write_text("".join(far))
    done = evaluate(tmp_path, "--poses", "t265", "--estimator", "bartlett", "--json", tmp_path / "r.json")
    assert done.exit_code == 0, done.output
    notes = json.loads((tmp_path / "r.json").read_text())["notes"]
    assert [(note["set"], note["tx"]) for note in notes if "the tracker drifted" in note["text"]] == [("Set_X", None)]
    assert "the tracker drifted" in done.output


def _numbered(rows: list[str]) -> list[tuple[int, list[str]]]:
    return [(n, row.split(",")) for n, row in enumerate(rows)]


@pytest.mark.parametrize("option", ["--json", "--out"])
def test_what_cannot_be_written_is_said_before_the_work(tmp_path: Path, option: str, monkeypatch: Any) -> None:
    write_run(tmp_path / "Set_X" / "L1", (4.0, 1.0, 0.8))
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("companion.commands.evaluate._evaluate_all", lambda *_: pytest.fail("it worked first"))
    done = evaluate(tmp_path, option, tmp_path / "file" / "below")
    assert isinstance(done.exception, CompanionError)
    assert "cannot be written" in str(done.exception)


def test_nothing_to_evaluate_is_an_error(tmp_path: Path) -> None:
    done = evaluate(tmp_path)
    assert isinstance(done.exception, CompanionError)
    assert "no recorded run" in str(done.exception)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], dict[str, Any]]:
    """What `evaluate` says of the recorded runs by one source of poses; computed once."""
    folder = tmp_path_factory.mktemp("recorded")

    @cache
    def result(poses: str) -> dict[str, Any]:
        if not DATA.is_dir():
            pytest.skip(f"no real captures at {DATA}")
        done = evaluate(DATA, "--poses", poses, "--jobs", 1, "--json", folder / f"{poses}.json")
        assert done.exit_code == 0, done.output
        content: dict[str, Any] = json.loads((folder / f"{poses}.json").read_text())
        return content

    return result


@pytest.mark.long
def test_line_of_sight_with_motion_capture_stays_under_two_degrees(recorded: Callable[[str], dict[str, Any]]) -> None:
    for name in ("LOS_Set_A", "LOS_Set_B"):
        figures = recorded("mocap")["sets"][name]
        print(name, figures)
        assert figures["n"] == 18
        assert figures["median_deg"] < 2.0
        assert figures["within_10"] == 1.0


@pytest.mark.parametrize(("count", "ranked"), [(18, False), (49, False), (50, True)])
def test_a_ranking_is_shown_with_its_interval_from_fifty_links_on(count: int, ranked: bool) -> None:
    rows = [replace(row("A", float(n), 1 - n / 100), profile_variance=1.0) for n in range(1, count + 1)]
    line = _trust_line(trust(rows))
    assert f"of {count} links" in line
    assert ("more reliable half (25 links)" in line and "(95 %)" in line) == ranked
    assert (f"{count} links, at least 50 are needed" in line) == (not ranked)


@pytest.mark.long
@pytest.mark.parametrize("poses", ["mocap", "t265"])
def test_reliability_is_calibrated_and_better_than_the_profile_variance(
    recorded: Callable[[str], dict[str, Any]], poses: str
) -> None:
    result = recorded(poses)
    worth, everything = result["trust"], result["sets"][ALL]
    print(worth)
    assert worth["reliable"] >= 10
    assert worth["reliable_within_3_std"] >= 0.9
    assert worth["area_reliability_deg"] < worth["area_profile_variance_deg"]
    assert worth["best_half"]["median_deg"] < everything["median_deg"]
    assert worth["best_half"]["mean_deg"] < everything["mean_deg"]
