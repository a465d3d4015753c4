"""The evaluation: what is counted, what is left out, and the figures, on runs of known truth and on recorded ones."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.analysis.evaluation import (
    ALL,
    UNEVALUATED_DEG,
    RunRows,
    evaluate_run,
    evaluation,
    risk_coverage,
    trust,
)
from companion.analysis.result import Options
from companion.analysis.runs import find_runs
from companion.analysis.trajectories import PoseKind
from tests.link_rows import row
from tests.synthetic_run import write_run


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
