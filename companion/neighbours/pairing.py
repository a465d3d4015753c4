"""How many of the packets we hear have their other half: forward packets against the reverse channels that arrive."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Final

import numpy as np

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.clock_relation import ClockRelation, card_times, match

_OPEN: Final = 2048
"""Packets of either direction that wait for their other half: over ten seconds' worth."""
_LONGEST_WAIT_NS: Final = 10 * NS_PER_S
"""A counter that comes again later is of another series."""
_SPAN_S: Final = 6
_LATE_S: Final = 1
_LEAST: Final = 20


class Pairing:
    """Bounded whatever arrives. What it pairs it also gives to the clock relation."""

    def __init__(self, relation: ClockRelation) -> None:
        self._relation = relation
        self._open: OrderedDict[int, int] = OrderedDict()
        """Forward packets by counter: time."""
        self._early: OrderedDict[int, tuple[int, int]] = OrderedDict()
        """Reverse channels that came before their forward packet was read, by counter: their time, arrival."""
        self._buckets: deque[list[int]] = deque(maxlen=_SPAN_S + _LATE_S + 1)
        """[second, forward packets, of which paired]"""
        self._uncounted: deque[tuple[int, int]] = deque(maxlen=_OPEN)
        """(time, card's stamp)"""
        self.paired = 0

    def clear(self) -> None:
        self._open.clear()
        self._early.clear()
        self._buckets.clear()
        self._uncounted.clear()

    def add_forward(self, frame: int | None, t_ns: int, nic_us: int) -> None:
        """A packet of the neighbour was heard at `t_ns`, by the card's clock at `nic_us`."""
        if frame is None:
            self._uncounted.append((t_ns, nic_us))
            self._count(t_ns, 1, 0)
            return
        if frame in self._open:
            del self._open[frame]  # heard twice: which one the other end means is unknown
            return
        theirs_ns, arrived_ns = self._early.pop(frame, (0, None))
        if arrived_ns is not None and abs(t_ns - arrived_ns) < _LONGEST_WAIT_NS:
            self._count(t_ns, 1, 1)
            self._exchange(t_ns, theirs_ns)
            return
        self._open[frame] = t_ns
        if len(self._open) > _OPEN:
            self._open.popitem(last=False)
        self._count(t_ns, 1, 0)

    def add_reverse(self, batch: wire.CsiBatch, counted: bool, now_ns: int) -> None:
        """Reverse channels arrived: in any order, late, early, or again."""
        if not counted:
            return
        for frame, theirs_ns in zip(batch.frame.tolist(), batch.t_ns.tolist(), strict=True):
            ours_ns = self._open.pop(frame, None)
            if ours_ns is None:
                self._early[frame] = theirs_ns, now_ns
                if len(self._early) > _OPEN:
                    self._early.popitem(last=False)
            elif now_ns - ours_ns < _LONGEST_WAIT_NS:
                self._count(ours_ns, 0, 1)
                self._exchange(ours_ns, theirs_ns)

    def match_uncounted(self, theirs: wire.CsiBatch, since_ns: int) -> None:
        """Without counters: both series of the last seconds at once, once a second or so."""
        ours = np.array([row for row in self._uncounted if row[0] >= since_ns], np.int64).reshape(-1, 2)
        ours_ns = card_times(ours[:, 1], ours[:, 0])
        theirs_ns = card_times(theirs.nic_us.astype(np.int64), theirs.t_ns)
        lag_ns = self._relation.add_uncounted(ours_ns, theirs_ns)
        for bucket in self._buckets:
            bucket[2] = 0
        if lag_ns is not None:
            for t_ns in ours_ns[match(ours_ns, theirs_ns, lag_ns)[0]].tolist():
                self._count(t_ns, 0, 1)

    def rate(self, now_ns: int) -> float | None:
        """Share of the forward packets of the last seconds that were paired; the newest second is left out, since its
        reverse channels may be on their way. None with too few packets."""
        last = now_ns // NS_PER_S - _LATE_S
        settled = [bucket for bucket in self._buckets if last - _SPAN_S < bucket[0] < last]
        forward = sum(bucket[1] for bucket in settled)
        return sum(bucket[2] for bucket in settled) / forward if forward >= _LEAST else None

    def _exchange(self, ours_ns: int, theirs_ns: int) -> None:
        self.paired += 1
        self._relation.add_exchange(ours_ns, theirs_ns)

    def _count(self, t_ns: int, forward: int, paired: int) -> None:
        second = t_ns // NS_PER_S
        for bucket in reversed(self._buckets):
            if bucket[0] == second:
                bucket[1] += forward
                bucket[2] += paired
                return
        if not self._buckets or second > self._buckets[-1][0]:
            self._buckets.append([second, forward, paired])
