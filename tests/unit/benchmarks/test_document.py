"""What docs/estimation.md and docs/results take from code: a row for every switch, parts to write them into, and the
cross-validation's arithmetic."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from benchmarks.ablation import DEFAULT, ROWS
from benchmarks.crossvalidation import HELD_OUT, OWN, Choice, bootstrap, folds, grid
from benchmarks.document import ABLATION, CROSS_VALIDATION, DOCS, SIMULATED, replace_part
from benchmarks.recorded import PUBLISHED, RecordedLink, Trials, cells, missed, table
from wsr.estimators.options import RobustOptions

STEPS = [field.name for field in fields(RobustOptions) if isinstance(getattr(DEFAULT, field.name), bool)]
"""Switches proper; the delay, the scales, the coherent step and the share of power are numbers that do the same."""
NUMBERS = ["delay_ns", "scales", "coherent_above", "power_share", "weak_below"]


@pytest.mark.parametrize("name", [*STEPS, *NUMBERS])
def test_every_step_has_a_row_of_its_own(name: str) -> None:
    changed = [[f.name for f in fields(o) if getattr(o, f.name) != getattr(DEFAULT, f.name)] for o in ROWS.values()]
    assert [name] in changed
    assert f"`{name}`" in (DOCS / "estimation.md").read_text()


def test_a_part_is_replaced_between_its_markers_and_nowhere_else(tmp_path: Path) -> None:
    document = tmp_path / "d.md"
    document.write_text("before\n<!-- generated: x -->\nold\n<!-- end: x -->\nafter\n")
    for _ in range(2):
        replace_part(document, "x", ["one", "two"])
        assert document.read_text() == "before\n<!-- generated: x -->\none\ntwo\n<!-- end: x -->\nafter\n"
    with pytest.raises(ValueError, match="generated: y"):
        replace_part(document, "y", ["one"])


@pytest.mark.parametrize(
    ("document", "name"), [(ABLATION, "ablation"), (SIMULATED, "simulated"), (CROSS_VALIDATION, "cross-validation")]
)
def test_the_document_has_the_part(document: Path, name: str, tmp_path: Path) -> None:
    copy = tmp_path / document.name
    copy.write_text(document.read_text())
    replace_part(copy, name, ["here"])
    assert f"<!-- generated: {name} -->\nhere\n" in copy.read_text()


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
