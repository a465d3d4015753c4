"""Times of a log's messages, where single ones, or all of one robot, are of another time altogether.

A message of time 0, or a robot whose clock was never set (1970), would stretch a flight over decades: what is drawn or
counted over time takes memory by the messages, not by the years between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
LONGEST_GAP_S: Final = 3600.0
_MOST_BINS: Final = 100_000


def main_span_ns(t_ns: Sequence[int]) -> tuple[int, int] | None:
    """First and last time of the stretch without a gap of an hour that most messages are of; None where all are."""
    ordered = np.sort(np.asarray(t_ns, np.uint64))
    if not ordered.size:
        return None
    ends = np.flatnonzero(np.diff(ordered) > np.uint64(LONGEST_GAP_S * 1e9)) + 1
    if not ends.size:
        return None
    edges = np.concatenate([[0], ends, [ordered.size]])
    longest = int(np.argmax(np.diff(edges)))
    return int(ordered[edges[longest]]), int(ordered[edges[longest + 1] - 1])


def bin_edges_s(duration_s: float) -> Floats:
    """From 0: of seconds, over more than a day of several seconds each; what is left at the end is no whole one."""
    seconds = max(1.0, np.floor(duration_s))
    width_s = max(1.0, np.ceil(seconds / _MOST_BINS))
    return np.asarray(np.arange(0.0, max(width_s, seconds) + width_s / 2, width_s))


def per_second(t_s: Sequence[float], duration_s: float) -> tuple[Floats, Floats]:
    """Seconds since the start and messages a second from each on."""
    edges_s = bin_edges_s(duration_s)
    counts, _ = np.histogram(t_s, edges_s)
    return edges_s[:-1], counts / np.diff(edges_s)
