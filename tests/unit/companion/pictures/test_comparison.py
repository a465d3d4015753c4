"""Two configurations on one flight, side by side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from companion.pictures.comparison import draw_comparison
from companion.replay.comparison import BearingRow

_ROW = BearingRow(
    peer=2, t_s=3.0, recorded_azimuth_deg=40.0, replayed_azimuth_deg=42.0, moved_deg=2.0, recorded_reliability=0.9,
    replayed_reliability=0.8, recorded_error_deg=-1.0, replayed_error_deg=3.0, recorded_refusal="", replayed_refusal="",
)  # fmt: skip
_REFUSED = replace(_ROW, t_s=6.0, replayed_azimuth_deg=None, moved_deg=None, replayed_error_deg=None)


def test_both_sides_and_how_far_they_are_apart(tmp_path: Path, shown: list[Figure]) -> None:
    draw_comparison(tmp_path / "c.png", [_ROW, _REFUSED], "log.mcap", "other.yaml")
    assert (tmp_path / "c.png").read_bytes()[:4] == b"\x89PNG"
    azimuths, moved, errors = shown[0].axes
    flown, other = azimuths.get_lines()
    assert (flown.get_label(), other.get_label()) == ("log.mcap", "other.yaml")
    assert np.asarray(flown.get_xydata()).tolist() == [[3.0, 40.0], [6.0, 40.0]]
    assert np.asarray(other.get_ydata()) == pytest.approx([42.0, np.nan], nan_ok=True)
    assert flown.get_marker() != other.get_marker(), "told apart without colour"
    assert [bar.get_bbox().height for bar in moved.patches if isinstance(bar, Rectangle)] == [2.0, 0.0]
    assert np.asarray(errors.get_lines()[0].get_ydata()).tolist() == [1.0, 1.0]


def test_without_a_truth_there_is_no_panel_of_errors(tmp_path: Path, shown: list[Figure]) -> None:
    blind = replace(_ROW, recorded_error_deg=None, replayed_error_deg=None)
    draw_comparison(tmp_path / "c.png", [blind], "a", "b")
    assert len(shown[0].axes) == 2
