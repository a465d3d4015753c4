"""Errors over the paper's geometries."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from companion.study.catalogue import study
from companion.study.study import Settings
from tests.paths import DATA
from tests.unit.companion.study.few_trials import check_leftovers, rows_of


@pytest.mark.long
def test_geometry_keeps_the_papers_order(tmp_path: Path) -> None:
    one = study("geometry")
    rows = rows_of(one, one.plan(Settings(10, DATA)))
    outcome = check_leftovers(one, rows, tmp_path)
    shares = [f.ours for f in outcome.findings if f.quantity.endswith("by the paper's measure")]
    line, curve, spatial = (float(share) for share in shares if share is not None)
    assert line < curve < spatial
    assert spatial >= 90.0
    bounds = {g: np.median([r.crb_deg for r in rows if r.geometry == g]) for g in ("2D line", "2D curve", "3D")}
    assert bounds["3D"] < bounds["2D curve"] < bounds["2D line"] == math.inf
