"""What lost and few packets cost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.study.catalogue import study
from companion.study.study import Settings
from tests.paths import DATA
from tests.unit.companion.study.few_trials import check_leftovers, rows_of


@pytest.mark.long
def test_packets_losses_are_as_asked_and_errors_come_with_refusals(tmp_path: Path) -> None:
    from companion.study import packets

    rng = np.random.default_rng(5)
    kept = packets._bursts(rng, 200_000, 0.5)
    assert np.mean(kept) == pytest.approx(0.5, abs=0.03)
    ends = np.count_nonzero(np.diff(kept.astype(int)) == 1)
    assert np.count_nonzero(~kept) / ends == pytest.approx(20, rel=0.1)
    one = study("packets")
    rows = rows_of(one, one.plan(Settings(2, DATA)))
    check_leftovers(one, rows, tmp_path)
    whole = next(r for row in rows for r in row.results if r.condition == "sparse pings")
    assert whole.packets > 400
    assert whole.error_deg["robust"] is not None
    sparsest = rows[0].results[-1]
    assert sparsest.packets < 25
