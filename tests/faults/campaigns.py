"""How long the campaigns of the fault tests are: short in `make test`, full in `make faults`."""

from __future__ import annotations

import os
from typing import Final

FULL: Final = os.environ.get("COMPANION_FAULTS") == "full"


def runs(short: int, full: int) -> int:
    """How often a fault is injected, or how much of it there is."""
    return full if FULL else short


def mutants(short: int = 10_000, full: int = 1_000_000) -> int:
    return runs(short, full)
