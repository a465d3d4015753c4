"""Trials on the processes of this machine."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import TypeVar

from numpy.random import SeedSequence

from companion.host.child import die_with_parent
from companion.study.trials import TrialError, batches, run_batch

S = TypeVar("S")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class ProcessRunner:
    """A pool of `jobs` processes, started anew for each run: a forked copy of a process with threads may hang."""

    jobs: int

    @property
    def name(self) -> str:
        return f"{self.jobs} processes"

    def run(
        self,
        trial: Callable[[S, SeedSequence], R],
        specs: Sequence[S],
        seed: int,
        on_done: Callable[[int, list[R]], None],
    ) -> list[R]:
        """As `TrialRunner.run`."""
        todo = list(batches(specs, seed, self.jobs))
        rows: dict[int, list[R]] = {}
        context = multiprocessing.get_context("spawn")
        workers = max(1, min(self.jobs, len(todo)))
        with ProcessPoolExecutor(workers, mp_context=context, initializer=die_with_parent) as pool:
            futures = {pool.submit(run_batch, trial, batch): batch for batch in todo}
            try:
                for future in as_completed(futures):
                    batch = futures[future]
                    rows[batch.first] = future.result()
                    on_done(batch.first, rows[batch.first])
            except BrokenProcessPool:
                raise TrialError("a worker process died; out of memory?") from None
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
        return [row for first in sorted(rows) for row in rows[first]]
