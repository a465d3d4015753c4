"""Trials on the processes of this machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from numpy.random import SeedSequence

from companion.host.pool import computed
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
        workers = max(1, min(self.jobs, len(todo)))
        try:
            with computed(partial(run_batch, trial), todo, workers, "spawn") as futures:
                for future in as_completed(futures):
                    batch = futures[future]
                    rows[batch.first] = future.result()
                    on_done(batch.first, rows[batch.first])
        except BrokenProcessPool:
            raise TrialError("a worker process died; out of memory?") from None
        return [row for first in sorted(rows) for row in rows[first]]
