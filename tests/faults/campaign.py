"""Short in `make test`, long in `make faults`."""

from __future__ import annotations

import os


def is_long() -> bool:
    return os.environ.get("FAULT_CAMPAIGN") == "long"


def runs(short: int, long: int) -> int:
    """How often a fault is injected: `long` where the environment has FAULT_CAMPAIGN=long."""
    return long if is_long() else short
