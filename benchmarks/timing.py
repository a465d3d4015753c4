"""The best of several runs: what the code costs, without what else the machine did meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable


def best_s(work: Callable[[], object], repeats: int = 7) -> float:
    """Shortest processor time [s] of `repeats` runs, after one that is not counted.

    On one thread it is the wall time of a machine that does nothing else, and hardly more on a busy one.
    """
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)
