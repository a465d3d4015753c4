"""Short in `make test`, long in `make faults`."""

from __future__ import annotations

import os


def runs(short: int, long: int) -> int:
    """How often a fault is injected: `long` where the environment has FAULT_CAMPAIGN=long."""
    return long if os.environ.get("FAULT_CAMPAIGN") == "long" else short
