"""Pictures: what is drawn where, read back from the figure's own artists and pixels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.pictures.profile import draw_profile
from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Profile


@dataclass(frozen=True)
class Found:
    azimuth_rad: float
    polar_rad: float


def top_view(tmp_path: Path, figures: list[Figure], polar_observable: bool) -> Axes:
    """Draws a picture, checks that it is one, and gives its left half."""
    power = np.random.default_rng(1).random((180, 360)).astype(np.float32)
    path = tmp_path / "new" / "p.png"
    estimate = Found(np.radians(40.0), np.radians(70.0))
    draw_profile(
        path,
        Profile(power, AZIMUTH_RAD, POLAR_RAD),
        estimate,
        (0.5, 1.5),
        title="title",
        azimuth_observable=True,
        polar_observable=polar_observable,
    )
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert ("elevation 20.0" in figures[0].get_suptitle()) == polar_observable
    assert "azimuth 40.0" in figures[0].get_suptitle()
    return figures[0].axes[0]


def test_an_estimate_with_both_angles_is_a_circle(tmp_path: Path, shown: list[Figure]) -> None:
    lines = {line.get_label(): line for line in top_view(tmp_path, shown, True).get_lines()}
    assert np.asarray(lines["estimate"].get_xydata()) == pytest.approx(np.array([[40.0, 20.0]]))
    assert lines["estimate"].get_marker() == "o"


def test_an_estimate_of_the_azimuth_only_is_a_line(tmp_path: Path, shown: list[Figure]) -> None:
    axes = top_view(tmp_path, shown, False)
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert "estimate" not in lines
    assert np.asarray(lines["estimate (azimuth only)"].get_xdata()) == pytest.approx([40.0, 40.0])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["estimate (azimuth only)", "true bearing"]
