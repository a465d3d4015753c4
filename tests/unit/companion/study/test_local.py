"""Trials in processes of this machine."""

from __future__ import annotations

import os
import signal

import pytest
from numpy.random import SeedSequence

from companion.study.catalogue import study
from companion.study.local import ProcessRunner
from companion.study.study import Settings
from companion.study.trials import TrialError
from tests.paths import DATA
from tests.unit.companion.study.few_trials import SEED, rows_of
from tests.unit.companion.study.trial_cases import CASES, Case
from tests.unit.companion.study.trial_cases import SEED as CASES_SEED


def test_processes_give_what_this_one_gives() -> None:
    one = study("crb")
    specs = one.plan(Settings(1, DATA))
    assert ProcessRunner(1).run(one.trial, specs, SEED, lambda first, rows: None) == rows_of(one, specs)


def test_a_dead_process_of_the_pool_is_reported() -> None:
    with pytest.raises(TrialError, match="a worker process died"):
        ProcessRunner(2).run(_suicide, CASES, CASES_SEED, lambda first, rows: None)


def _suicide(case: Case, seed: SeedSequence) -> float:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0.0
