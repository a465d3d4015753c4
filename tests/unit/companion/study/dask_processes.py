"""A Dask cluster of processes on loopback."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from companion.study.cluster import DaskRunner
from companion.study.trials import RunnerError

_START_S = 60.0


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


@contextmanager
def connected(address: str, workers: int) -> Iterator[DaskRunner]:
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
