"""Processes that share a long computation: a signal is for who started them, and ends them at once."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Final, TypeVar

from companion.host.child import die_with_parent

T = TypeVar("T")
R = TypeVar("R")
_ENDS: Final = (signal.SIGTERM, signal.SIGHUP)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the block as a Ctrl-C does: dying of them, it would give back nothing that it holds of the
    system's (semaphores, its workers' folders). One that is ignored (nohup), or taken already, stays so."""
    taken = [number for number in _ENDS if signal.getsignal(number) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


@contextmanager
def computed(
    function: Callable[[T], R], tasks: Iterable[T], workers: int, method: str | None = None
) -> Iterator[dict[Future[R], T]]:
    """`function` of each task, begun in `workers` processes, started as `method` says ("spawn", "fork"). What ends the
    block early ends the processes, in mid computation; SIGTERM and SIGHUP end it as a Ctrl-C does. On the main thread.
    """
    context = multiprocessing.get_context(method)
    with ended_by_signals():
        with _kept_off(signal.SIGHUP):  # multiprocessing's own helper keeps the others off by itself
            pool = ProcessPoolExecutor(workers, mp_context=context, initializer=die_with_parent)
        with pool:
            try:
                with _kept_off(signal.SIGINT, *_ENDS):
                    futures = {pool.submit(function, task): task for task in tasks}
                yield futures
            except BaseException:
                for process in multiprocessing.active_children():
                    process.kill()
                pool.shutdown(cancel_futures=True)
                raise


@contextmanager
def _kept_off(*numbers: signal.Signals) -> Iterator[None]:
    """Processes that are begun within never hear of these signals."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
