"""The evaluation: what is counted, what is left out, and the figures, on runs of known truth and on recorded ones."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from companion.analysis.bearings import analyze_run
from companion.analysis.evaluation import (
    ALL,
    UNEVALUATED_DEG,
    LinkRow,
    RunRows,
    evaluate_run,
    evaluation,
    risk_coverage,
    trust,
)
from companion.analysis.result import Options
from companion.analysis.runs import find_runs
from companion.analysis.trajectories import PoseKind
from companion.cli import program
from companion.commands.evaluate import _trust_line
from companion.errors import CompanionError
from tests import paths
from tests.synthetic_run import write_run

DATA = paths.DATA / "wsr_dataset_dev"
SPATIAL = DATA.parent / "wsr_3d"


def row(set_name: str, error_deg: float, reliability: float = 0.9, reason: str = "") -> LinkRow:
    return LinkRow(
        set=set_name,
        position="L1",
        run="run",
        tx="tx2",
        error_deg=error_deg,
        azimuth_deg=0.0,
        true_azimuth_deg=0.0,
        polar_deg=None,
        true_polar_deg=None,
        elevation_deg=None,
        true_elevation_deg=None,
        azimuth_std_deg=1.0,
        reliability=reliability,
        packets=500,
        reason=reason,
    )


def evaluate(*arguments: object) -> Result:
    return CliRunner().invoke(program, ["evaluate", *map(str, arguments)], catch_exceptions=True)


def test_figures_by_set_and_in_all() -> None:
    rows = [row("A", 1.0), row("A", 3.0), row("A", 20.0, reliability=0.1), row("B", UNEVALUATED_DEG, 0.0, "no file")]
    result = evaluation([RunRows(rows[:3], [], []), RunRows(rows[3:], [], [])], "mocap", "robust", 0.5)
    assert (result.sets["A"].n, result.sets["A"].median_deg, result.sets["A"].mean_deg) == (3, 3.0, 8.0)
    assert result.sets["A"].within_10 == pytest.approx(2 / 3)
    assert result.sets["B"].mean_deg == 180.0
    assert result.sets[ALL].n == 4
    assert result.reliable["A"].n == 2
    assert "B" not in result.reliable


def test_risk_falls_with_reliability_when_it_is_honest() -> None:
    rows = [row("A", error, 1 - error / 100) for error in (40.0, 2.0, 10.0, 4.0)]
    coverage, risk = risk_coverage(rows)
    np.testing.assert_allclose(coverage, [0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(risk, [2.0, 3.0, 16 / 3, 14.0])


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


def _cut(path: Path) -> None:
    rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join(rows[: len(rows) // 2]))


def _spoil_a_line(path: Path) -> None:
    path.write_text(path.read_text().replace("\n", "\nlost,", 1))


SPOILED_MOCAP: dict[str, Callable[[Path], object]] = {
    "cut": _cut,
    "empty": lambda path: path.write_text(""),
    "bad line": _spoil_a_line,
    "missing": Path.unlink,
}


@pytest.mark.parametrize("what", SPOILED_MOCAP)
def test_a_link_whose_truth_cannot_be_known_counts_as_180_degrees(tmp_path: Path, what: str) -> None:
    run = write_run(tmp_path / "Set_X" / "L1", (4.0, 1.0, 0.8))
    shutil.copy(run.trajectory, run.folder / f"t265_{run.trajectory.name}")
    options = Options(kind=PoseKind.T265, estimator="bartlett")
    (sound,) = evaluate_run(find_runs(tmp_path)[0], options).links
    assert sound.error_deg < 5 and not sound.reason
    SPOILED_MOCAP[what](run.trajectory)
    rows = evaluate_run(find_runs(tmp_path)[0], options)
    assert [row.error_deg for row in rows.links] == [UNEVALUATED_DEG]
    assert run.trajectory.name in rows.links[0].reason and "true place" in rows.links[0].reason
    assert rows.left_out == []


@pytest.mark.parametrize(
    ("content", "because"),
    [
        ("{", "not a JSON file"),
        (None, "is missing"),
        ('{"channel": {"value": 108}, "true_tx_positions": {"value": {}}}', "has no position of tx2"),
    ],
)
def test_without_a_true_position_the_truth_file_is_named(tmp_path: Path, content: str | None, because: str) -> None:
    run = write_run(tmp_path / "Set_X" / "L1", (4.0, 1.0, 0.8))
    if content is None:
        run.truth.unlink()
    else:
        run.truth.write_text(content)
    (row,) = evaluate_run(find_runs(tmp_path)[0], Options(kind=PoseKind.MOCAP, estimator="bartlett")).links
    assert row.error_deg == UNEVALUATED_DEG
    assert run.truth.name in row.reason and because in row.reason
    assert "--channel" not in row.reason


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


def test_line_of_sight_with_motion_capture_stays_under_two_degrees(tmp_path: Path) -> None:
    if not DATA.is_dir():
        pytest.skip(f"no real captures at {DATA}")
    for name in ("LOS_Set_A", "LOS_Set_B"):
        done = evaluate(DATA / name, "--json", tmp_path / "r.json")
        assert done.exit_code == 0, done.output
        figures = json.loads((tmp_path / "r.json").read_text())["sets"][name]
        print(name, figures)
        assert figures["n"] == 18
        assert figures["median_deg"] < 2.0
        assert figures["within_10"] == 1.0


def test_trust_compares_the_reliability_with_the_profile_variance() -> None:
    rows = [replace(row("A", error, 1 - error / 100), profile_variance=1 / error) for error in (40.0, 2.0, 10.0, 4.0)]
    result = trust(rows)
    assert result.area_reliability_deg == pytest.approx(np.mean([2.0, 3.0, 16 / 3, 14.0]))
    assert result.area_profile_variance_deg == pytest.approx(np.mean([40.0, 25.0, 18.0, 14.0]))
    assert (result.best_half.n, result.best_half.mean_deg) == (2, 3.0)
    assert (result.links, result.reliable) == (4, 3)
    low, high = result.area_difference_deg
    assert low <= result.area_reliability_deg - result.area_profile_variance_deg <= high
    assert result.best_half_gain_deg[0] <= 14.0 - 3.0 <= result.best_half_gain_deg[1]
    assert trust(rows) == result  # the same draws every time
    assert result.reliable_within_3_std == pytest.approx(1 / 3)


@pytest.mark.parametrize(("count", "ranked"), [(18, False), (49, False), (50, True)])
def test_a_ranking_is_shown_with_its_interval_from_fifty_links_on(count: int, ranked: bool) -> None:
    rows = [replace(row("A", float(n), 1 - n / 100), profile_variance=1.0) for n in range(1, count + 1)]
    line = _trust_line(trust(rows))
    assert f"of {count} links" in line
    assert ("more reliable half (25 links)" in line and "(95 %)" in line) == ranked
    assert (f"{count} links, at least 50 are needed" in line) == (not ranked)


@pytest.mark.parametrize("poses", ["mocap", "t265"])
def test_reliability_is_calibrated_and_better_than_the_profile_variance(tmp_path: Path, poses: str) -> None:
    if not DATA.is_dir():
        pytest.skip(f"no real captures at {DATA}")
    done = evaluate(DATA, "--poses", poses, "--json", tmp_path / "r.json")
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "r.json").read_text())
    worth, everything = result["trust"], result["sets"][ALL]
    print(worth)
    assert worth["reliable"] >= 10
    assert worth["reliable_within_3_std"] >= 0.9
    assert worth["area_reliability_deg"] < worth["area_profile_variance_deg"]
    assert worth["best_half"]["median_deg"] < everything["median_deg"]
    assert worth["best_half"]["mean_deg"] < everything["mean_deg"]


def test_spatial_runs_give_both_transmitters_within_five_degrees() -> None:
    if not SPATIAL.is_dir():
        pytest.skip(f"no real captures at {SPATIAL}")
    links = [link for run in find_runs(SPATIAL) for link in analyze_run(run, Options(kind=PoseKind.MOCAP)).links]
    assert len(links) == 6
    for link in links:
        assert link.estimate is not None
        assert link.truth is not None
        assert link.azimuth_error_rad is not None, link.notes
        assert link.great_circle_error_rad is not None, link.notes
        assert abs(link.azimuth_error_rad) < np.radians(5)
        assert abs(link.estimate.polar_rad - link.truth.polar_rad) < np.radians(5)
