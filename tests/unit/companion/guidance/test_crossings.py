"""Where a line of sight passes those before it."""

from __future__ import annotations

import numpy as np
import pytest

from companion.guidance.crossings import Crossings

REACH_M = (0.5, 40.0)
EAST, NORTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def _ranges_m(lines: Crossings, place_m: tuple[float, float, float], unit: np.ndarray, count: int = 200) -> np.ndarray:
    units = np.tile(unit, (count, 1))
    return lines.ranges_m(
        np.array(place_m), units, np.full(count, 7.0), reach_m=REACH_M, rng=np.random.default_rng(count)
    )


def test_without_lines_ranges_are_the_others() -> None:
    assert np.all(_ranges_m(Crossings(), (0.0, 0.0, 0.0), EAST) == 7.0)


def test_a_line_is_passed_give_or_take_a_share_of_the_range() -> None:
    lines = Crossings()
    lines.add(np.array([5.0, -3.0, 0.0]), NORTH)
    found = _ranges_m(lines, (0.0, 0.0, 0.0), EAST)
    assert np.median(found) == pytest.approx(5.0, rel=0.05) and np.log(found).std() == pytest.approx(0.2, rel=0.2)
    lines.shift(np.array([1.0, 0.0, 0.0]))
    assert np.median(_ranges_m(lines, (0.0, 0.0, 0.0), EAST)) == pytest.approx(6.0, rel=0.05)


@pytest.mark.parametrize(
    ("place_m", "unit"),
    [((8.0, 0.0, 0.0), EAST), ((4.9, 0.0, 0.0), EAST), ((-90.0, 0.0, 0.0), EAST), ((0.0, 0.0, 0.0), NORTH)],
    ids=["behind", "too near", "too far", "parallel"],
)
def test_what_is_not_passed_within_reach_has_the_other_range(
    place_m: tuple[float, float, float], unit: np.ndarray
) -> None:
    lines = Crossings()
    lines.add(np.array([5.0, -3.0, 0.0]), NORTH)
    assert np.all(_ranges_m(lines, place_m, unit) == 7.0)


def test_the_newest_are_kept() -> None:
    lines = Crossings()
    for _ in range(3):
        lines.add(np.zeros(3), EAST)
    for _ in range(20):
        lines.add(np.array([5.0, -3.0, 0.0]), NORTH)
    assert lines.directions().shape == (20, 3) and np.all(lines.directions() == NORTH)
    assert np.all(_ranges_m(lines, (0.0, 0.0, 0.0), EAST) != 7.0)
    lines.clear()
    assert np.all(_ranges_m(lines, (0.0, 0.0, 0.0), EAST) == 7.0)
