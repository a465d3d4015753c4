"""What runs trials: every runner passes the same tests, and a lost worker changes nothing."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.random import SeedSequence

from companion.errors import ConfigError
from companion.study.cluster import DaskRunner
from companion.study.local import ProcessRunner
from companion.study.trials import RunnerError, TrialError, TrialRunner, batches, trial_seed

_START_S = 60.0
SEED = 7


@dataclass(frozen=True, slots=True)
class Case:
    """`folder` is where the trial leaves the number of its process."""

    size: int
    folder: str = ""
    seconds: float = 0.0


def trial(case: Case, seed: SeedSequence) -> list[float]:
    """Algebra that rounds differently over several threads, from the trial's own random stream."""
    if case.folder:
        (Path(case.folder) / f"{os.getpid()}").touch()
    time.sleep(case.seconds)
    a = np.random.default_rng(seed).normal(size=(case.size, case.size))
    return [float(value) for value in np.linalg.svd(a @ a.T)[1][:3]]


def failing(case: Case, seed: SeedSequence) -> float:
    if case.size == 13:
        raise ValueError("thirteen")
    return 0.0


CASES = [Case(60 + i) for i in range(25)]


@cache
def wanted() -> list[list[float]]:
    return ProcessRunner(1).run(trial, CASES, SEED, lambda first, rows: None)


@contextmanager
def dask_processes(workers: int) -> Iterator[tuple[str, list[int]]]:
    """A scheduler and workers as processes of their own on loopback: its address, and their process ids."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    port = address.rpartition(":")[2]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "DASK_LOGGING__DISTRIBUTED": "error",
    }
    started = [_dask(environment, "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")]
    try:
        options = ("--host", "127.0.0.1", "--no-nanny", "--nthreads", "1", "--memory-limit", "0", "--no-dashboard")
        started += [_dask(environment, "worker", address, *options) for _ in range(workers)]
        yield address, [process.pid for process in started[1:]]
    finally:
        for process in reversed(started):
            process.kill()
            process.wait()


def _dask(environment: dict[str, str], *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "dask", *arguments]
    return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def cluster() -> Iterator[DaskRunner]:
    with dask_processes(2) as (address, _), _connected(address, 2) as runner:
        yield runner


@contextmanager
def _connected(address: str, workers: int) -> Iterator[DaskRunner]:
    """Once all workers have reported."""
    deadline = time.monotonic() + _START_S
    while True:
        try:
            runner = DaskRunner(address)
        except RunnerError:
            assert time.monotonic() < deadline, "the scheduler or its workers did not start"
            time.sleep(0.3)
            continue
        if f"{workers} workers" in runner.name:
            with runner:
                yield runner
            return
        runner.__exit__(None, None, None)
        time.sleep(0.3)


RUNNERS = ["2 processes", "dask"]


@pytest.fixture(params=RUNNERS)
def runner(request: pytest.FixtureRequest) -> TrialRunner:
    if request.param == "dask":
        found = request.getfixturevalue("cluster")
        assert isinstance(found, DaskRunner)
        return found
    return ProcessRunner(int(request.param.split()[0]))


def test_same_seed_same_numbers_in_order_whatever_runs_them(runner: TrialRunner) -> None:
    done: dict[int, list[list[float]]] = {}
    rows = runner.run(trial, CASES, SEED, done.__setitem__)
    assert rows == wanted()  # to the last bit
    assert [row for first in sorted(done) for row in done[first]] == rows
    assert len(done) > 1
    assert rows != runner.run(trial, CASES, SEED + 1, lambda first, rows: None)


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


def test_a_killed_worker_costs_nothing_but_time(tmp_path: Path) -> None:
    """Two worker processes; one is killed after both have computed, with most trials still to come."""
    cases = [Case(case.size, str(tmp_path), 0.05) for case in CASES]
    with dask_processes(2) as (address, pids), _connected(address, 2) as runner:
        killed: list[int] = []

        def kill_one(first: int, done: list[list[float]]) -> None:
            if not killed and all((tmp_path / str(pid)).exists() for pid in pids):
                os.kill(pids[0], signal.SIGKILL)
                killed.append(pids[0])

        rows = runner.run(trial, cases, SEED, kill_one)
    assert killed, "no worker was killed: the test shows nothing"
    assert {path.name for path in tmp_path.iterdir()} == {str(pid) for pid in pids}
    assert rows == wanted()


def test_a_dead_process_of_the_pool_is_reported() -> None:
    with pytest.raises(TrialError, match="a worker process died"):
        ProcessRunner(2).run(_suicide, CASES, SEED, lambda first, rows: None)


def _suicide(case: Case, seed: SeedSequence) -> float:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0.0


def test_local_cluster_of_our_own() -> None:
    with DaskRunner("local:1") as runner:
        assert runner.run(trial, CASES[:4], SEED, lambda first, rows: None) == wanted()[:4]


@pytest.mark.parametrize("address", ["local:x", "local:0", "nonsense://?"])
def test_an_address_that_is_none(address: str) -> None:
    with pytest.raises(ConfigError, match=r"expected tcp://HOST:PORT .* or local:N"):
        DaskRunner(address)


def test_nobody_listens() -> None:
    """In a process of its own: Dask's loops of the tests before would otherwise have a part in it."""
    code = (
        "import sys; from companion.study import cluster; cluster._CONNECT_S = 0.5\n"
        "from companion.errors import CompanionError\n"
        "try: cluster.DaskRunner(sys.argv[1])\n"
        "except CompanionError as error: print(error)"
    )
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: nobody answers here
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        done = subprocess.run(
            [sys.executable, "-c", code, address], capture_output=True, text=True, timeout=60, check=True
        )
    assert "no Dask scheduler answers" in done.stdout and address in done.stdout
