"""A neighbour's monotonic clock on ours, from the exchanges both ends stamped. No NTP, no wall clock.

Both ends hear the same exchange, the answer a turnaround (0.13 to 0.6 ms) after the ping. So each shared counter gives
their stamp less ours, right to that, and the median of many is the offset. Where the driver gives no counters the same
exchanges show as a peak in the correlation of both series of times, near the offset that the fastest datagram allows.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

LOCKED_NS: Final = 5_000_000
_TURNAROUND_NS: Final = 300_000
_TURNAROUND_DOUBT_NS: Final = 300_000
_KEPT: Final = 256
_LEAST: Final = 16
_DRIFT: Final = 100e-6
_DATAGRAMS: Final = 100
_LONGEST_DELAY_NS: Final = 60_000_000
_BIN_NS: Final = 100_000
_MATCH_NS: Final = 400_000

Times = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Offset:
    """Their clock less ours [ns] and how far that may be off [ns]; `samples` exchanges it rests on."""

    offset_ns: int
    uncertainty_ns: float
    samples: int

    @property
    def is_locked(self) -> bool:
        return self.uncertainty_ns <= LOCKED_NS


class ClockRelation:
    """`we_ping`: whether we send the pings, so that the other end hears each exchange first."""

    def __init__(self, we_ping: bool) -> None:
        self._turnaround_ns = _TURNAROUND_NS if we_ping else -_TURNAROUND_NS
        self._samples: deque[tuple[int, int]] = deque(maxlen=_KEPT)
        self._latest_sent: deque[int] = deque(maxlen=_DATAGRAMS)

    def clear(self) -> None:
        """The neighbour has rebooted, or the pinging robot has: nothing known holds any more."""
        self._samples.clear()
        self._latest_sent.clear()

    def add_exchange(self, ours_ns: int, theirs_ns: int) -> None:
        """One exchange, stamped by both."""
        self._samples.append((ours_ns, theirs_ns - ours_ns + self._turnaround_ns))

    def add_datagram(self, arrived_ns: int, sent_ns: int) -> None:
        """Arrival on our clock, sending on theirs: a bound, since nothing arrives before it was sent."""
        self._latest_sent.append(sent_ns - arrived_ns)

    def add_uncounted(self, ours_ns: Times, theirs_ns: Times) -> None:
        """Times of the packets that each end heard of the other during the same few seconds, in any order."""
        lag_ns = self.lag_ns(ours_ns, theirs_ns)
        if lag_ns is not None:
            self._samples.clear()
            for ours, theirs in zip(*match(ours_ns, theirs_ns, lag_ns), strict=True):
                self.add_exchange(int(ours_ns[ours]), int(theirs_ns[theirs]))

    def lag_ns(self, ours_ns: Times, theirs_ns: Times) -> int | None:
        """Their stamp of an exchange less ours, from the times alone; None where no lag stands out.

        It lies between the offset of the fastest datagram and that plus the longest delay of the network.
        """
        if not self._latest_sent or min(len(ours_ns), len(theirs_ns)) < _LEAST:
            return None
        least_ns = max(self._latest_sent) - 2 * _TURNAROUND_NS
        return _correlate(np.sort(ours_ns), np.sort(theirs_ns), least_ns, least_ns + _LONGEST_DELAY_NS)

    def offset(self, now_ns: int) -> Offset | None:
        """None before enough exchanges are shared."""
        if len(self._samples) < _LEAST:
            return None
        samples = np.array([offset for _, offset in self._samples])
        middle = int(np.median(samples))
        spread = 1.4826 * float(np.median(np.abs(samples - middle)))
        uncertainty = _TURNAROUND_DOUBT_NS + spread + _DRIFT * (now_ns - self._samples[-1][0])
        if self._latest_sent:
            # By this offset a datagram would have arrived before it was sent: the counters lie by at least so much.
            uncertainty += max(0, max(self._latest_sent) - middle)
        return Offset(middle, uncertainty, len(samples))


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


def _correlate(ours_ns: Times, theirs_ns: Times, least_ns: int, most_ns: int) -> int | None:
    """The lag at which most packets coincide, if it is by far the best."""
    first = np.searchsorted(theirs_ns, ours_ns + least_ns)
    last = np.searchsorted(theirs_ns, ours_ns + most_ns)
    counts = last - first
    if not counts.sum():
        return None
    ours = np.repeat(ours_ns, counts)
    starts = np.repeat(first - np.concatenate([[0], np.cumsum(counts)[:-1]]), counts)
    lags = theirs_ns[starts + np.arange(len(ours))] - ours
    histogram = np.bincount((lags - least_ns) // _BIN_NS, minlength=int((most_ns - least_ns) // _BIN_NS) + 1)
    smooth = np.convolve(histogram, np.ones(3, np.int64), "same")
    best = int(smooth.argmax())
    away = np.abs(np.arange(len(smooth)) - best) > 4 * _MATCH_NS // _BIN_NS
    if smooth[best] < max(_LEAST, 2 * smooth[away].max(initial=0)):
        return None
    near = lags[np.abs(lags - least_ns - (best + 0.5) * _BIN_NS) <= 1.5 * _BIN_NS]
    return int(np.median(near))
