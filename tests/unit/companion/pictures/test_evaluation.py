"""Pictures of an evaluation say what its figures say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from companion.analysis.evaluation import Evaluation, RunRows, evaluation
from companion.pictures.evaluation import draw_error_cdfs, draw_risk_coverage
from tests.link_rows import row


@pytest.fixture
def result() -> Evaluation:
    rows = [row("A", error, 1 - error / 100) for error in (1.0, 2.0, 4.0, 30.0)] + [row("B", 8.0)]
    return evaluation([RunRows(rows, [], [])], "mocap", "robust", 0.5)


def test_each_set_is_a_line_to_the_share_below_each_error(
    tmp_path: Path, shown: list[Figure], result: Evaluation
) -> None:
    draw_error_cdfs(tmp_path / "cdf.png", result)
    assert (tmp_path / "cdf.png").read_bytes()[:4] == b"\x89PNG"
    first, second, limit = shown[0].axes[0].get_lines()
    assert first.get_label() == "A: median 3.0°, n = 4"
    assert np.asarray(first.get_xydata()).tolist() == [[0, 0], [1, 0.25], [2, 0.5], [4, 0.75], [30, 1]]
    assert second.get_label() == "B: median 8.0°, n = 1"
    assert first.get_linestyle() != second.get_linestyle(), "told apart without colour"
    assert set(np.asarray(limit.get_xdata()).tolist()) == {10}


def test_risk_is_drawn_against_the_share_that_is_kept(tmp_path: Path, shown: list[Figure], result: Evaluation) -> None:
    draw_risk_coverage(tmp_path / "risk.png", result)
    reliable, _, mean = shown[0].axes[0].get_lines()
    assert np.asarray(reliable.get_ydata())[-1] == pytest.approx(9.0)
    assert np.asarray(reliable.get_ydata())[0] == pytest.approx(1.0)
    assert mean.get_label() == "all links: 9.0°"
