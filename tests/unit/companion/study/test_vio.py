"""What a real tracker's poses cost."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.study.catalogue import study
from companion.study.study import Settings
from tests.paths import DATA
from tests.unit.companion.study.few_trials import check_leftovers, rows_of


@pytest.mark.long
@pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")
def test_vio_measures_a_real_tracker(tmp_path: Path) -> None:
    one = study("vio")
    rows = rows_of(one, one.plan(Settings(1, DATA)))
    check_leftovers(one, rows, tmp_path)
    (row,) = rows
    assert 0.0 < row.drift.ate_m < 0.3
    assert 0.3 < row.drift.length_m < 5.0
    assert {link.estimator for link in row.links} == {"bartlett", "robust"}
