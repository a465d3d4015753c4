"""The study of whole missions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from companion.study.catalogue import study
from companion.study.study import Settings
from companion.study.trials import trial_seed
from tests.paths import DATA
from tests.unit.companion.study.few_trials import SEED, check_leftovers


def test_rendezvous_is_the_same_mission_for_the_same_seed(tmp_path: Path) -> None:
    one = study("rendezvous")
    (case, *_) = one.plan(Settings(1, DATA))
    first = one.trial(case, trial_seed(SEED, 1))
    assert len(first.steps) > 3
    assert case.flies_on
    assert first.arrived_m is not None
    assert first.arrived_m < first.closest_m <= 2.0
    short = one.trial(replace(case, flies_on=False), trial_seed(SEED, 1))
    assert replace(first, flown_on=False, arrived_m=None) == short
    assert first.reached == (first.closest_m <= 2.0)
    assert first.reached or first.end in ("arrived", "landing", "latched", "holding", "approaching", "acquiring")
    assert all(step.distance_m > first.closest_m - 0.5 for step in first.steps)
    errors = [step.error.great_circle_deg for step in first.steps if step.error is not None]
    assert np.median(errors) < 10.0
    assert all(step.informativeness_deg is not None for step in first.steps if step.error is not None)
    check_leftovers(one, [first], tmp_path)
