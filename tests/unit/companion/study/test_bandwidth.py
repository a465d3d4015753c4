"""Wider packets tell the first path from what comes later, in the same room and on the same aperture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.study.bandwidth import ROOMS, WIDTHS_MHZ, BandwidthCase
from companion.study.catalogue import study
from companion.study.study import Settings
from tests.paths import DATA
from tests.unit.companion.study.few_trials import check_leftovers, rows_of


@pytest.mark.long
def test_in_an_occluded_room_80_mhz_halve_the_error_of_20(tmp_path: Path) -> None:
    one = study("bandwidth")
    cases = one.plan(Settings(6, DATA))
    assert len(cases) == 6 * len(ROOMS)
    rows = rows_of(one, [case for case in cases if case.room in ("hard", "hard-10db")])
    check_leftovers(one, rows, tmp_path)
    for room in ("hard", "hard-10db"):
        mean = {w: np.mean([r.errors[w].great_circle_deg for r in rows if r.room == room]) for w in WIDTHS_MHZ}
        assert mean[80] <= 0.5 * mean[20]
        assert mean[160] <= 0.5 * mean[20]


@pytest.mark.long
def test_one_aperture_is_heard_by_every_width() -> None:
    (row,) = rows_of(study("bandwidth"), [BandwidthCase("hall", 0)])
    assert set(row.errors) == set(WIDTHS_MHZ)
    assert all(error.azimuth_deg < 10.0 for error in row.errors.values())
