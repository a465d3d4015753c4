"""The worker's start: what is kept is read; what is not, two processes compile, or one where there is no more."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.sensing import worker


class Beside:
    """The process beside the worker, as `multiprocessing` makes it."""

    def __init__(self, done: list[str], error: OSError | None = None) -> None:
        self._done = done
        self._error = error

    def Process(self, target: Callable[..., None], args: tuple[object, ...]) -> Beside:
        self._todo = target, args
        return self

    def start(self) -> None:
        if self._error is not None:
            raise self._error
        target, arguments = self._todo
        target(*arguments)

    def join(self) -> None:
        self._done.append("join")


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """What is done, in its order, where no code is kept."""
    calls: list[str] = []
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(worker, "_compile_beside", lambda cores: calls.append(f"beside on {len(cores)}"))
    monkeypatch.setattr(worker, "compile_packets", lambda: calls.append("compile_packets"))
    monkeypatch.setattr(worker, "warm_up", lambda name: calls.append(f"warm_up {name}"))
    monkeypatch.setattr(worker, "get_context", lambda _: Beside(calls))
    return calls


def test_a_first_start_shares_out_what_there_is_to_compile(done: list[str]) -> None:
    worker._warm_up("robust", os.sched_getaffinity(0))
    assert done == [f"beside on {len(os.sched_getaffinity(0))}", "compile_packets", "join", "warm_up robust"]


def test_without_a_process_more_one_compiles_all(done: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    full = OSError(errno.EAGAIN, "Resource temporarily unavailable")
    monkeypatch.setattr(worker, "get_context", lambda _: Beside(done, full))
    worker._warm_up("robust", os.sched_getaffinity(0))
    assert done == ["warm_up robust"]


def test_what_is_kept_is_read_by_one(done: list[str], tmp_path: Path) -> None:
    (tmp_path / "wsr").mkdir()
    (tmp_path / "wsr" / "kernel._sum_up-1.py311.nbi").touch()
    assert worker.is_compiled()
    worker._warm_up("robust", os.sched_getaffinity(0))
    assert done == ["warm_up robust"]


def test_little_is_compiled_by_one(done: list[str]) -> None:
    worker._warm_up("bartlett", os.sched_getaffinity(0))
    assert done == ["warm_up bartlett"]
