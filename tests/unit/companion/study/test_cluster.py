"""Trials on a Dask cluster: a lost worker changes nothing, an address that leads nowhere is named. What every runner
passes is in `test_trials.py`."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from companion.errors import ConfigError
from companion.study.cluster import DaskRunner
from tests.unit.companion.study.dask_processes import connected, dask_processes
from tests.unit.companion.study.trial_cases import CASES, SEED, Case, trial, wanted


@pytest.mark.long
def test_a_killed_worker_costs_nothing_but_time(tmp_path: Path) -> None:
    """Two worker processes; one is killed after both have computed, with most trials still to come."""
    cases = [Case(case.size, str(tmp_path), 0.05) for case in CASES]
    with dask_processes(2) as (address, pids), connected(address, 2) as runner:
        killed: list[int] = []

        def kill_one(first: int, done: list[list[float]]) -> None:
            if not killed and all((tmp_path / str(pid)).exists() for pid in pids):
                os.kill(pids[0], signal.SIGKILL)
                killed.append(pids[0])

        rows = runner.run(trial, cases, SEED, kill_one)
    assert killed, "no worker was killed: the test shows nothing"
    assert {path.name for path in tmp_path.iterdir()} == {str(pid) for pid in pids}
    assert rows == wanted()


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
