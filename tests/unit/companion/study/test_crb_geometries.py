"""The bound over the paper's geometries."""

from __future__ import annotations

import math
from pathlib import Path

from companion.study.catalogue import study
from companion.study.study import Settings
from tests.paths import DATA
from tests.unit.companion.study.few_trials import check_leftovers, rows_of


def test_crb_helix_beats_circle_at_the_90th_percentile_of_theta_and_a_line_has_no_bound(tmp_path: Path) -> None:
    one = study("crb")
    rows = rows_of(one, one.plan(Settings(1, DATA)))
    for phase in ("known", "unknown"):
        helix, circle, line = (next(r for r in rows if (r.geometry, r.phase) == (g, phase)) for g in _GEOMETRIES)
        assert helix.at("theta", 0.9) < circle.at("theta", 0.9) < line.at("theta", 0.9) == math.inf
        assert line.infinite_share == 1.0
        assert math.isfinite(line.at("theta_alone", 0.5))
        assert math.isfinite(line.at("phi_alone", 0.5))
    outcome = check_leftovers(one, rows, tmp_path)
    orders = {f.quantity: f.ours for f in outcome.findings if f.quantity.startswith("order")}
    assert orders["order by CRB_theta, phase unknown, 90th percentile"] == "helix < circle < line"
    assert orders["order by CRB_phi, phase known, median"] == "circle < helix < line"  # not the paper's


_GEOMETRIES = ("helix", "circle", "line")
