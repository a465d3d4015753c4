"""What runs trials: every runner passes the same tests."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.random import SeedSequence

from companion.study.cluster import DaskRunner
from companion.study.local import ProcessRunner
from companion.study.trials import TrialError, TrialRunner, batches, trial_seed
from tests.unit.companion.study.trial_cases import CASES, SEED, Case, failing, trial, wanted


@pytest.fixture(scope="module")
def clusters() -> Iterator[dict[str, DaskRunner]]:
    """One of our own, and the same by the address of its scheduler, as another's would be."""
    with DaskRunner("local:1") as own, DaskRunner(own._client.scheduler.address) as there:
        yield {"local:1": own, "tcp": there}


RUNNERS = ["2 processes", "local:1", "tcp"]


@pytest.fixture(params=RUNNERS)
def runner(request: pytest.FixtureRequest) -> TrialRunner:
    if request.param == "2 processes":
        return ProcessRunner(2)
    found = request.getfixturevalue("clusters")[request.param]
    assert isinstance(found, DaskRunner)
    return found


def test_same_seed_same_numbers_in_order_whatever_runs_them(runner: TrialRunner) -> None:
    done: dict[int, list[list[float]]] = {}
    rows = runner.run(trial, CASES, SEED, done.__setitem__)
    assert rows == wanted()  # to the last bit
    assert [row for first in sorted(done) for row in done[first]] == rows
    assert len(done) > 1
    assert rows[:1] != runner.run(trial, CASES[:1], SEED + 1, lambda first, rows: None)


def test_no_trials_are_no_rows(runner: TrialRunner) -> None:
    assert runner.run(trial, [], SEED, lambda first, rows: None) == []


def test_a_failing_trial_is_named(runner: TrialRunner) -> None:
    with pytest.raises(TrialError, match=r"trial 3 \(seed 7\): ValueError: thirteen"):
        runner.run(failing, [Case(10 + i) for i in range(20)], SEED, lambda first, rows: None)


def test_streams_are_the_children_of_the_seed_however_they_are_cut() -> None:
    children = SeedSequence(SEED).spawn(5)
    for index, child in enumerate(children):
        assert trial_seed(SEED, index).generate_state(4).tolist() == child.generate_state(4).tolist()
    for workers in (1, 2, 7, 100):
        cut = list(batches(CASES, SEED, workers))
        assert [case for batch in cut for case in batch.specs] == CASES
        firsts = [batch.first for batch in cut]
        assert firsts == np.cumsum([0, *(len(batch.specs) for batch in cut[:-1])]).tolist()
