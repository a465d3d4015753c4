"""Both ends move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.study.catalogue import study
from companion.study.study import Settings
from tests.paths import DATA
from tests.unit.companion.study.few_trials import check_leftovers, rows_of


@pytest.mark.long
def test_moving_ends_need_the_others_displacement_in_ones_own_axes(tmp_path: Path) -> None:
    one = study("moving-ends")
    rows = rows_of(one, one.plan(Settings(3, DATA)))
    check_leftovers(one, rows, tmp_path)
    helix = [row.errors for row in rows if row.scenario == "helix"]

    def median(variant: str) -> float:
        return float(np.median([errors[f"robust, {variant}"].great_circle_deg for errors in helix]))

    assert median("corrected") < 2.0
    assert median("own axes, turned to North") == pytest.approx(median("corrected"), abs=0.05)
    assert median("clocks 38 s apart, joined by the exchange") == pytest.approx(median("corrected"), abs=0.2)
    assert median("not corrected") > 2 * median("corrected")
    assert median("own axes, not turned") > 2 * median("corrected")
    assert median("clocks 5 s apart, joined by time") > 2 * median("corrected")
