"""The picture of a flight: both paths, every bearing, North and scale, read back from the figure's own artists."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from companion.pictures.flight import Arrow, draw_flight

UAV_M = np.column_stack([np.linspace(0.0, 12.0, 50), np.zeros(50), np.full(50, 1.5)])
TARGET_M = np.column_stack([np.full(50, 12.0), np.linspace(-1.0, 2.0, 50), np.full(50, 1.5)])
BEARINGS = [Arrow(3, 2.0, 0.0, 0.1), Arrow(4, 4.0, 0.0, math.pi / 2)]


def drawn(path: Path, figures: list[Figure], turned: bool = False) -> tuple[Figure, Axes]:
    order = [1, 0, 2] if turned else [0, 1, 2]
    draw_flight(path, UAV_M[:, order], TARGET_M[:, order], BEARINGS, title="title")
    assert path.read_bytes()[:4] == b"\x89PNG"
    return figures[0], figures[0].axes[0]


def annotated(axes: Axes) -> list[Annotation]:
    return [child for child in axes.get_children() if isinstance(child, Annotation)]


def test_both_paths_and_the_distance_at_the_end_are_drawn(tmp_path: Path, shown: list[Figure]) -> None:
    _, axes = drawn(tmp_path / "f.png", shown)
    lines = {str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.get_lines()}
    np.testing.assert_array_equal(lines["drone"], UAV_M[:, :2])
    np.testing.assert_array_equal(lines["ground robot"], TARGET_M[:, :2])
    np.testing.assert_array_equal(lines["at the end: 2.0 m apart"], [UAV_M[-1, :2], TARGET_M[-1, :2]])
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("East [m]", "North [m]", 1.0)


def test_every_bearing_points_where_it_says_and_has_its_number(tmp_path: Path, shown: list[Figure]) -> None:
    _, axes = drawn(tmp_path / "f.png", shown)
    arrows = [each for each in annotated(axes) if each.get_text() == ""]
    for arrow, bearing in zip(arrows, BEARINGS, strict=True):
        head, tail = np.asarray(arrow.xy), np.asarray(arrow.xyann)
        assert tuple(tail) == (bearing.east_m, bearing.north_m)
        assert math.atan2(*(head - tail)[::-1]) == pytest.approx(bearing.azimuth_rad)
    assert [each.get_text() for each in annotated(axes) if each.get_text()] == ["3", "4", "N"]


def test_a_number_stands_off_its_arrow(tmp_path: Path, shown: list[Figure]) -> None:
    """Behind the tail and to the left: of an arrow to the North, South-West of its tail."""
    _, axes = drawn(tmp_path / "f.png", shown)
    number = next(each for each in annotated(axes) if each.get_text() == "4")
    assert np.asarray(number.xyann) == pytest.approx([-9.0, -8.0])


def test_north_is_up_beside_the_map(tmp_path: Path, shown: list[Figure]) -> None:
    _, axes = drawn(tmp_path / "f.png", shown)
    arrow = next(each for each in annotated(axes) if each.get_text() == "N")
    assert arrow.xy[0] > 1.0
    assert arrow.xyann[0] == 0 and arrow.xyann[1] < 0


@pytest.mark.parametrize("turned", [False, True])
def test_the_map_fills_the_picture_whichever_way_the_flight_went(
    tmp_path: Path, shown: list[Figure], turned: bool
) -> None:
    figure, axes = drawn(tmp_path / "f.png", shown, turned)
    box = axes.get_window_extent()
    assert (box.width * box.height) / (figure.bbox.width * figure.bbox.height) > (0.25 if turned else 0.6)
    narrow, wide = sorted([box.width, box.height])
    assert narrow / wide >= 0.44
