"""What drifting poses cost."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from companion.study.catalogue import study
from companion.study.study import Settings
from companion.study.trials import trial_seed
from tests.paths import DATA
from tests.unit.companion.study.few_trials import SEED, check_leftovers, rows_of


@pytest.mark.long
def test_drift_grows_with_the_error_and_scales_it_to_the_ate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from companion.study import drift

    one = study("drift")
    monkeypatch.setattr(drift, "_ATE_M", drift._TABLE_ATE_M)  # those that the findings are of
    for case in (drift.DriftCase("3D helix", "random walk", 0.15), drift.DriftCase("2D circle", "velocity bias", 0.1)):
        error = drift._error(case, np.random.default_rng(3))
        assert math.sqrt(float(np.mean(np.sum(error**2, axis=1)))) == pytest.approx(case.ate_m)
        assert not error[0].any()
    check_leftovers(one, rows_of(one, one.plan(Settings(1, DATA))), tmp_path)
    # One error drawn, at two scales: the least-squares answer is in proportion to it.
    small, large = (
        one.trial(drift.DriftCase("3D helix", "random walk", ate), trial_seed(SEED, 0)) for ate in (0.05, 0.1)
    )
    ratio = large.errors["least squares"].polar_deg / small.errors["least squares"].polar_deg
    assert ratio == pytest.approx(2.0, rel=0.1)
