"""Processes that share a long computation: a Ctrl-C is for who started them, and ends them at once."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from companion.host.child import die_with_parent

T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def computed(
    function: Callable[[T], R], tasks: Iterable[T], workers: int, method: str | None = None
) -> Iterator[dict[Future[R], T]]:
    """`function` of each task, begun in `workers` processes, started as `method` says ("spawn", "fork"). What ends the
    block early ends the processes, in mid computation."""
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(workers, mp_context=context, initializer=die_with_parent) as pool:
        try:
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the processes begun here keep that
            try:
                futures = {pool.submit(function, task): task for task in tasks}
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            yield futures
        except BaseException:
            for process in multiprocessing.active_children():
                process.kill()
            pool.shutdown(cancel_futures=True)
            raise
