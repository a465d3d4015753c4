"""Trials and what runs them: the same seed gives the same numbers, whatever the parallelism.

Trial i of a study has its own random stream, child i of the study's seed (`numpy.random.SeedSequence`), and sees
nothing but its specification. Numerical libraries run on one thread, because sums split over threads round otherwise.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from numpy.random import SeedSequence
from threadpoolctl import threadpool_limits

from companion.errors import CompanionError

S = TypeVar("S")
R = TypeVar("R")

_BATCHES_A_WORKER = 12
_LARGEST_BATCH = 4
"""Small enough that a slow batch at the end holds nothing up for long, the progress bar moves, and a run that ends
early loses little."""
_COLLECTED_EVERY = 100_000
"""Objects that may hold one another. By Python's own 700 a tenth of a mission would be the search for such that nobody
needs, among the half million that imports and machine code leave for good."""


class TrialError(CompanionError):
    """A trial, or the process it ran in, failed; the message says which and why."""


class RunnerError(CompanionError):
    """What runs trials is not there, or no longer: no other study can be run either."""


@dataclass(frozen=True, slots=True)
class Batch(Generic[S]):
    """Consecutive trials `first`, `first` + 1, ... of a study with `seed`."""

    first: int
    specs: tuple[S, ...]
    seed: int


class TrialRunner(Protocol):
    """Carries out trials. `run` returns their rows in the order of the specifications, and calls `on_done` each time
    some have ended, with the number of the first of them and their rows. Raises TrialError and RunnerError."""

    @property
    def name(self) -> str: ...

    def run(
        self,
        trial: Callable[[S, SeedSequence], R],
        specs: Sequence[S],
        seed: int,
        on_done: Callable[[int, list[R]], None],
    ) -> list[R]: ...


def trial_seed(seed: int, index: int) -> SeedSequence:
    """The random stream of trial `index`: that of `SeedSequence(seed).spawn(...)[index]`."""
    return SeedSequence(seed, spawn_key=(index,))


def batches(specs: Sequence[S], seed: int, workers: int) -> Iterator[Batch[S]]:
    """All trials in order; how they are cut does not show in the results."""
    size = min(_LARGEST_BATCH, max(1, math.ceil(len(specs) / (workers * _BATCHES_A_WORKER))))
    for first in range(0, len(specs), size):
        yield Batch(first, tuple(specs[first : first + size]), seed)


def run_batch(trial: Callable[[S, SeedSequence], R], batch: Batch[S]) -> list[R]:
    """The rows of one batch, in a worker process. Raises TrialError with the number of the trial that failed."""
    rows = []
    with threadpool_limits(1), _seldom_collected():
        for index, spec in enumerate(batch.specs, start=batch.first):
            try:
                rows.append(trial(spec, trial_seed(batch.seed, index)))
            except CompanionError as error:
                raise TrialError(f"trial {index} (seed {batch.seed}): {error}") from None
            except (ArithmeticError, LookupError, TypeError, ValueError) as error:
                raise TrialError(f"trial {index} (seed {batch.seed}): {type(error).__name__}: {error}") from error
    return rows


@contextmanager
def _seldom_collected() -> Iterator[None]:
    """Trials leave few objects that hold one another, and what was there before them is not looked at."""
    before = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(_COLLECTED_EVERY)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()
