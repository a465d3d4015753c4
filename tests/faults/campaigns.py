"""How long the campaigns of the fault tests are: short in `make test`, full in `make faults`. Recordings beyond a
few are tests of their own, which `make test-long` runs as well.
"""

from __future__ import annotations

import os
from typing import Final

import pytest

from companion.analysis.runs import find_runs
from tests.paths import DATA

FULL: Final = os.environ.get("COMPANION_FAULTS") == "full"


def runs(short: int, full: int) -> int:
    """How often a fault is injected, or how much of it there is."""
    return full if FULL else short


def mutants(short: int = 10_000, full: int = 1_000_000) -> int:
    return runs(short, full)


def recordings(first: bool) -> list[object]:
    """All recorded runs as parameters of a test. All are long but one: the first of the last set, or else the last
    run of the first set, so that between them two tests take runs of two sets, of one and of two transmitters."""
    runs = find_runs(DATA) if DATA.is_dir() else []
    named = {run.set_name: run for run in (reversed(runs) if first else runs)}
    short = [named[(max if first else min)(named)]] if named else []
    return [
        pytest.param(
            run,
            id=f"{run.set_name}-{run.stamp}",
            marks=[] if run in short else [pytest.mark.long],
        )
        for run in runs
    ]
