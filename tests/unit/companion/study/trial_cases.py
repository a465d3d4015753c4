"""Trials that any runner must run to the same last bit."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.random import SeedSequence

from companion.study.local import ProcessRunner

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
