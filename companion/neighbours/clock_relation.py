"""A neighbour's monotonic clock on ours, from the exchanges both ends stamped. No NTP, no wall clock.

Both ends hear the same exchange, the answer a turnaround (0.13 to 0.6 ms) after the ping. So each shared counter gives
their stamp less ours, right to that, and the median of many is the offset. Counters that lie give an offset that does
too, so it must also agree with the datagrams: none arrives before it was sent, neither theirs here nor ours there.
Where the driver gives no counters the same exchanges show as a peak in the correlation of both series of times, near
the offset that the fastest datagram allows.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from wsr.middle import median

LOCKED_NS: Final = 5_000_000
_TURNAROUND_NS: Final = 300_000
_TURNAROUND_DOUBT_NS: Final = 300_000
_KEPT: Final = 256
_LEAST: Final = 16
_DRIFT: Final = 100e-6
_MAX_DRIFT: Final = 5e-3
"""Ten times what Linux slews a clock by; one host of the recordings is at 3500 ppm."""
_LEAST_SPAN_NS: Final = 500_000_000
_DATAGRAMS: Final = 100
_RECENT_NS: Final = 1_000_000_000
_BOUNDED_BY_NS: Final = 5_000_000_000
"""How old a datagram may be that bounds the offset: of twenty neighbours each is echoed every two seconds."""
_LONGEST_DELAY_NS: Final = 60_000_000
_SLACK_NS: Final = 20_000_000
"""How far the middle of many host times may be off: hosts read late, never early."""
_BIN_NS: Final = 100_000
_MATCH_NS: Final = 400_000
_MATCH_BINS: Final = _MATCH_NS // _BIN_NS
_CANDIDATES: Final = 40
_COVER_NS: Final = 20_000_000
_CLEAR: Final = 3
_CLEAR_SHARE: Final = 0.3
"""By how many packets more the second lag must leave alone: in recordings 4 to 8 of 1000, and 7 to 12 at the right."""

Times = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Offset:
    """Their clock less ours [ns] and how far that may be off [ns]; `samples` exchanges it rests on.

    `round_trip_ns` of the fastest datagrams there and back, by which counters can lie unnoticed; None before both ways
    have been heard of.
    """

    offset_ns: int
    uncertainty_ns: float
    samples: int
    round_trip_ns: int | None

    @property
    def is_locked(self) -> bool:
        return self.uncertainty_ns <= LOCKED_NS


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """What the exchanges and datagrams say, whatever the time is: fitted once for all who ask until the next one."""

    newest_ns: int
    slope: float
    middle: float
    spread: float
    beyond_ns: float
    """By how much the worst bound is violated."""
    round_trip_ns: int | None


class ClockRelation:
    """`we_ping`: whether we send the pings, so that the other end hears each exchange first."""

    def __init__(self, we_ping: bool) -> None:
        self._turnaround_ns = _TURNAROUND_NS if we_ping else -_TURNAROUND_NS
        self._samples: deque[tuple[int, int]] = deque(maxlen=_KEPT)
        self._sent: deque[tuple[int, int]] = deque(maxlen=_DATAGRAMS)
        """(arrival, sending less arrival)"""
        self._echoed: deque[tuple[int, int]] = deque(maxlen=_DATAGRAMS)
        """(our sending, their arrival less that)"""
        self._line: _Line | None = None
        """Fitted, until there is something new."""

    def clear(self) -> None:
        """The neighbour has rebooted, or the pinging robot has: nothing known holds any more."""
        self._samples.clear()
        self._sent.clear()
        self._echoed.clear()
        self._line = None

    def add_exchange(self, ours_ns: int, theirs_ns: int) -> None:
        """One exchange, stamped by both."""
        self._samples.append((ours_ns, theirs_ns - ours_ns + self._turnaround_ns))
        self._line = None

    def add_datagram(self, arrived_ns: int, sent_ns: int) -> None:
        """Arrival on our clock, sending on theirs: a bound, since nothing arrives before it was sent."""
        self._sent.append((arrived_ns, sent_ns - arrived_ns))
        self._line = None

    def add_echo(self, sent_ns: int, arrived_ns: int) -> None:
        """One of our datagrams: sending on our clock, arrival on theirs. A bound from the other side."""
        self._echoed.append((sent_ns, arrived_ns - sent_ns))
        self._line = None

    def add_uncounted(self, ours_ns: Times, theirs_ns: Times) -> int | None:
        """Times of the packets that each end heard of the other during the same few seconds, as of `card_times`.
        Returns the lag as `lag_ns` does."""
        lag_ns = self.lag_ns(ours_ns, theirs_ns)
        if lag_ns is not None:
            self._samples.clear()
            self._line = None
            for ours, theirs in zip(*match(ours_ns, theirs_ns, lag_ns), strict=True):
                self.add_exchange(int(ours_ns[ours]), int(theirs_ns[theirs]))
        return lag_ns

    def lag_ns(self, ours_ns: Times, theirs_ns: Times) -> int | None:
        """Their stamp of an exchange less ours, from the times alone; None where no lag stands out.

        It lies between the offset of the fastest datagram and that plus the longest delay of the network.
        """
        if not self._sent or min(len(ours_ns), len(theirs_ns)) < _LEAST:
            return None
        least_ns = max(sent for _, sent in self._sent) - _SLACK_NS
        return correlate(np.sort(ours_ns), np.sort(theirs_ns), least_ns, least_ns + _LONGEST_DELAY_NS)

    def offset(self, now_ns: int) -> Offset | None:
        """At `now_ns`; None before enough exchanges are shared.

        A host clock that is being slewed drifts by milliseconds within the samples, so that they lie about a line.
        """
        if len(self._samples) < _LEAST:
            return None
        line = self._line = self._line or self._fitted()
        ahead_ns = now_ns - line.newest_ns
        uncertainty = _TURNAROUND_DOUBT_NS + line.spread + _DRIFT * ahead_ns
        uncertainty += line.beyond_ns
        return Offset(round(line.middle + line.slope * ahead_ns), uncertainty, len(self._samples), line.round_trip_ns)

    def _fitted(self) -> _Line:
        at_ns, samples = np.array(self._samples, np.int64).T
        newest_ns = int(at_ns.max())
        slope = _slope(at_ns, samples)
        level = samples - slope * (at_ns - newest_ns)
        middle = median(level)
        spread = 1.4826 * median(np.abs(level - middle))
        first_ns, slack = int(at_ns.min()), max(2 * _DRIFT, abs(slope))

        def beyond_ns(at: int, bound: int, sign: int) -> float:
            """By how much the line is on the wrong side of a bound; before its first exchange it may be off."""
            return sign * (bound - middle - slope * (at - newest_ns)) - slack * max(0, first_ns - at)

        # By this offset a datagram would have arrived before it was sent: the counters lie by at least so much.
        least = [beyond_ns(at, bound, 1) for at, bound in _recent(self._sent, newest_ns)]
        most = [beyond_ns(at, bound, -1) for at, bound in _recent(self._echoed, newest_ns)]
        round_trip_ns = -round(max(least) + max(most)) if least and most else None
        return _Line(
            newest_ns=newest_ns,
            slope=slope,
            middle=middle,
            spread=spread,
            beyond_ns=max([0.0, *least, *most]),
            round_trip_ns=round_trip_ns,
        )


def _recent(bounds: Iterable[tuple[int, int]], newest_ns: int) -> list[tuple[int, int]]:
    """Those of the last second, since a card's clock is known the better the longer it was heard; older ones where
    there are none."""
    for reach_ns in (_RECENT_NS, _BOUNDED_BY_NS):
        if found := [(at, bound) for at, bound in bounds if at >= newest_ns - reach_ns]:
            return found
    return []


def _slope(at_ns: Times, samples_ns: Times) -> float:
    """Drift between the clocks from the medians of the first and the last third, 0 where time says nothing of it."""
    third = len(at_ns) // 3
    first, last = slice(None, third), slice(-third, None)
    span_ns, rise_ns = (
        median(values[last]) - median(values[first])
        for values in (at_ns.astype(np.float64), samples_ns.astype(np.float64))
    )
    if span_ns < _LEAST_SPAN_NS:
        return 0.0
    rise = rise_ns / span_ns
    return min(_MAX_DRIFT, max(-_MAX_DRIFT, rise))


def card_times(nic_us: npt.NDArray[np.int64], t_ns: Times) -> Times:
    """Times (N,) [ns] of packets in their order: even as the card stamped them, and in the middle as the host read."""
    steps_us = np.diff(nic_us.astype(np.uint32)).view(np.int32).astype(np.int64)
    card_ns = np.concatenate([[0], np.cumsum(steps_us)]) * 1000 if len(nic_us) else np.zeros(0, np.int64)
    return card_ns + int(np.median(t_ns - card_ns)) if len(nic_us) else card_ns


def match(ours_ns: Times, theirs_ns: Times, lag_ns: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices (K,) of packets of both ends that belong together where theirs less ours is `lag_ns`, jitter allowed."""
    order = np.argsort(theirs_ns, kind="stable")
    sorted_ns = theirs_ns[order]
    right = np.clip(np.searchsorted(sorted_ns, ours_ns + lag_ns), 0, len(sorted_ns) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(
        np.abs(sorted_ns[left] - ours_ns - lag_ns) < np.abs(sorted_ns[right] - ours_ns - lag_ns), left, right
    )
    apart = np.abs(sorted_ns[nearer] - ours_ns - lag_ns)
    i = np.flatnonzero(apart <= _MATCH_NS)
    # A packet that two want goes to the nearer one.
    by_distance = i[np.argsort(apart[i], kind="stable")]
    _, first = np.unique(nearer[by_distance], return_index=True)
    i = np.sort(by_distance[first])
    return i, order[nearer[i]]


def _covered(ours_ns: Times, theirs_ns: Times, lag_ns: int) -> int:
    """Packets of ours from stretches of which theirs arrived at all: a lost datagram says nothing of a lag."""
    at = np.searchsorted(theirs_ns, ours_ns + lag_ns)
    before = theirs_ns[np.maximum(at - 1, 0)]
    after = theirs_ns[np.minimum(at, len(theirs_ns) - 1)]
    nearest = np.minimum(np.abs(ours_ns + lag_ns - before), np.abs(after - ours_ns - lag_ns))
    return int(np.count_nonzero(nearest <= _COVER_NS))


def correlate(ours_ns: Times, theirs_ns: Times, least_ns: int, most_ns: int) -> int | None:
    """The lag at which most packets coincide.

    Pings are nearly periodic, so every period gives a lag at which most do. But what we heard is an answer to what they
    heard: at the right lag every packet of ours has its other half, but for those that their host lost; at a wrong one
    also those are missing whose neighbour in time was lost. None where that does not tell them apart.
    """
    first = np.searchsorted(theirs_ns, ours_ns + least_ns)
    counts = np.searchsorted(theirs_ns, ours_ns + most_ns) - first
    if not counts.sum():
        return None
    starts = np.repeat(first - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    lags = theirs_ns[starts + np.arange(counts.sum())] - np.repeat(ours_ns, counts)
    histogram = np.bincount((lags - least_ns) // _BIN_NS, minlength=int((most_ns - least_ns) // _BIN_NS) + 1)
    smooth = np.convolve(histogram, np.ones(2 * _MATCH_BINS + 1, np.int64), "same")
    found: list[tuple[int, int]] = []
    while len(found) < _CANDIDATES and smooth.max() >= max(_LEAST, len(ours_ns) // 2):
        best = int(smooth.argmax())
        near = lags[np.abs(lags - least_ns - (best + 0.5) * _BIN_NS) <= _MATCH_NS]
        if len(near):
            lag_ns = int(np.median(near))
            found.append((_covered(ours_ns, theirs_ns, lag_ns) - len(match(ours_ns, theirs_ns, lag_ns)[0]), lag_ns))
        smooth[max(0, best - 3 * _MATCH_BINS) : best + 3 * _MATCH_BINS + 1] = 0
    found.sort()
    if not found or (len(found) > 1 and found[1][0] - found[0][0] < max(_CLEAR, _CLEAR_SHARE * found[0][0])):
        return None
    return found[0][1]
