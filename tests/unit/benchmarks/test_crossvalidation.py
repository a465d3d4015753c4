"""What is held out, and which choices are compared."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.crossvalidation import HELD_OUT, OWN, Choice, bootstrap, folds, grid
from benchmarks.recorded import PUBLISHED, RecordedLink, Trials, cells, missed, table


def test_what_is_held_out_has_no_part_in_the_choice() -> None:
    links = [RecordedLink("LOS_Set_A mocap", place, "tx2", f"run {place}") for place in ("L2", "L6", "L9")]
    # The second choice is better everywhere but at L9, where it fails.
    done = Trials(links, np.array([[5.0, 5.0, 5.0], [1.0, 1.0, 90.0]]), np.full((2, 3), np.nan))
    choices = [OWN, Choice(1.0, (1,), 0.1)]
    found, held_out = folds(done, choices, HELD_OUT["position"], 180.0)
    assert [(fold.held_out, fold.chosen) for fold in found] == [("L2", OWN), ("L6", OWN), ("L9", choices[1])]
    np.testing.assert_array_equal(held_out, [5.0, 5.0, 90.0])
    with pytest.raises(ValueError, match="tx2"):
        folds(done, choices, HELD_OUT["transmitter"], 180.0)
    low, high = bootstrap(links, np.array([1.0, 1.0, 90.0]))["LOS_Set_A mocap"]
    # Of three draws of three the mean is at least 60 in one of four and 1 in three of ten.
    assert low[1] == 1.0 and high[1] > 60.0


def test_the_default_is_in_the_grid_and_cells_are_compared_with_the_published_figures() -> None:
    assert OWN in grid()
    links = [RecordedLink(cell, "L2", "tx2", "run") for cell in (*PUBLISHED, "3D mocap")]
    errors = np.array([7.0 if link.cell == "LOS_Set_B t265" else 1.0 for link in links])
    assert missed(cells(links, errors)) == [("LOS_Set_B t265", "median")]
    row = list(table(links, [("name", errors, errors)]))[-1]
    assert row.split(" | ")[0] == "| name" and row.split(" | ")[-2:] == ["9 of 10", "1.0, 1.0 |"]
