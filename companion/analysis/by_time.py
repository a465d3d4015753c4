"""Exchanges without counters: whose packets belong together by the times of both cards alone.

An AX card's driver gives neither frame counters nor a host clock that agrees with the other's; what it has is a clock
of 3.125 ns. Between pings lie random times, so that of all lags between both cards' clocks one lets nearly every packet
of ours have its other half, where a wrong one leaves many alone. Crystals drift apart by tens of microseconds a second:
from the stretch where the lag was found it is followed both ways.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.neighbours.clock_relation import correlate, match

_STRETCH_NS: Final = 4_000_000_000
_MOST: Final = 1000
"""Packets of a stretch: with all lags against the other log they make a table."""
_TRIED: Final = 3

Times = npt.NDArray[np.int64]
Indices = npt.NDArray[np.intp]


def pair_by_card_time(ours_us: npt.NDArray[np.float64], theirs_us: npt.NDArray[np.float64]) -> tuple[Indices, Indices]:
    """Indices (K,) of both logs' packets that belong together, from unwrapped times (N,) and (M,) [us] of each one's
    own card; none where no lag stands out."""
    ours_ns, theirs_ns = (np.rint(times * 1e3).astype(np.int64) for times in (ours_us, theirs_us))
    nothing = np.zeros(0, np.intp)
    if not len(ours_ns) or not len(theirs_ns):
        return nothing, nothing
    by_time = np.argsort(theirs_ns, kind="stable")
    stretches = list(_stretches(ours_ns))
    for start in sorted(range(len(stretches)), key=lambda number: -len(stretches[number]))[:_TRIED]:
        chosen = stretches[start][:_MOST]
        least = int(theirs_ns.min() - ours_ns[chosen].max())
        most = int(theirs_ns.max() - ours_ns[chosen].min())
        lag_ns = correlate(np.sort(ours_ns[chosen]), theirs_ns[by_time], least, most)
        if lag_ns is not None:
            return _followed(ours_ns, theirs_ns, stretches, start, lag_ns=lag_ns)
    return nothing, nothing


def _stretches(ours_ns: Times) -> Iterator[Indices]:
    """Packets of some seconds each, in the order of time."""
    order = np.argsort(ours_ns, kind="stable")
    number = (ours_ns[order] - ours_ns[order[0]]) // _STRETCH_NS
    yield from np.split(order, np.flatnonzero(np.diff(number)) + 1)


def _followed(
    ours_ns: Times, theirs_ns: Times, stretches: list[Indices], start: int, *, lag_ns: int
) -> tuple[Indices, Indices]:
    found: list[tuple[Indices, Indices]] = []
    for way in (range(start, len(stretches)), range(start - 1, -1, -1)):
        lag = lag_ns
        for number in way:
            chosen = stretches[number]
            i, j = match(ours_ns[chosen], theirs_ns, lag)
            if len(i):
                lag = int(np.median(theirs_ns[j] - ours_ns[chosen[i]]))
                i, j = match(ours_ns[chosen], theirs_ns, lag)
            found.append((chosen[i], j))
    ours, theirs = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(ours, kind="stable")
    # A packet of theirs at the border of two stretches goes to one of ours.
    _, first = np.unique(theirs[order], return_index=True)
    kept = order[np.sort(first)]
    return np.asarray(ours[kept], np.intp), np.asarray(theirs[kept], np.intp)
