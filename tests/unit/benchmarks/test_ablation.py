"""The steps whose worth is measured."""

from __future__ import annotations

from dataclasses import fields

import pytest

from benchmarks.ablation import DEFAULT, ROWS
from benchmarks.document import DOCS
from wsr.estimators.options import RobustOptions

WIDE = "first_path"
"""Acts over 60 MHz and more, which no recording has; `companion study bandwidth` measures what it is worth."""
STEPS = [
    field.name
    for field in fields(RobustOptions)
    if isinstance(getattr(DEFAULT, field.name), bool) and field.name != WIDE
]
"""Switches proper; the delay, the scales, the coherent step and the share of power are numbers that do the same."""
NUMBERS = ["delay_ns", "scales", "coherent_above", "power_share", "weak_below"]


@pytest.mark.parametrize("name", [*STEPS, *NUMBERS])
def test_every_step_has_a_row_of_its_own(name: str) -> None:
    changed = [[f.name for f in fields(o) if getattr(o, f.name) != getattr(DEFAULT, f.name)] for o in ROWS.values()]
    assert [name] in changed
    assert f"`{name}`" in (DOCS / "estimation.md").read_text()
