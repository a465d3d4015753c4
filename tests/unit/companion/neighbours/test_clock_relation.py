"""The relation of two clocks without counters, and a card's stamps on its own clock."""

from __future__ import annotations

import numpy as np

from companion.core.clock import NS_PER_S
from companion.neighbours.clock_relation import ClockRelation, card_times, match

OFFSET_NS = 56 * NS_PER_S + 370_000_000


def test_without_counters_the_times_alone_relate_the_clocks() -> None:
    rng = np.random.default_rng(3)
    ours_ns = np.cumsum(4_000_000 + rng.normal(0, 60_000, 1500)).astype(np.int64)
    pings_ns = ours_ns + OFFSET_NS - 300_000 + rng.normal(0, 30_000, 1500).astype(np.int64)
    heard_them = rng.random(1500) > 0.06  # a ping they miss is never answered
    answered = heard_them & (rng.random(1500) > 0.05)
    reported = heard_them & (rng.random(1500) > 0.005)
    ours_ns, theirs_ns = ours_ns[answered], pings_ns[reported]
    relation = ClockRelation(we_ping=True)
    relation.add_datagram(0, OFFSET_NS - 7_000_000)  # 7 ms on the way
    lag_ns = relation.add_uncounted(ours_ns, theirs_ns)
    assert lag_ns is not None
    assert abs(lag_ns - OFFSET_NS + 300_000) < 100_000
    offset = relation.offset(int(ours_ns[-1]))
    assert offset is not None
    assert offset.is_locked
    assert abs(offset.offset_ns - OFFSET_NS) < 200_000
    i, j = match(ours_ns, theirs_ns, lag_ns)
    assert len(i) > 0.98 * len(ours_ns)
    assert np.abs(theirs_ns[j] - ours_ns[i] - OFFSET_NS + 300_000).max() < 400_000


def test_a_perfectly_regular_series_tells_nothing() -> None:
    ours_ns = np.arange(1500, dtype=np.int64) * 4_000_000
    relation = ClockRelation(we_ping=True)
    relation.add_datagram(0, 0)
    assert relation.lag_ns(ours_ns, ours_ns) is None


def test_card_times_follow_the_cards_clock_across_its_wrap() -> None:
    nic_us = (np.arange(100) * 5000 + 4_294_900_000) % (1 << 32)
    t_ns = np.arange(100, dtype=np.int64) * 5_000_000 + 17
    jittered = t_ns + np.random.default_rng(1).integers(0, 3_000_000, 100)
    times = card_times(nic_us, jittered)
    assert np.unique(np.diff(times)).tolist() == [5_000_000]
    assert 0 < times[0] - 17 < 3_000_000
    assert len(card_times(nic_us[:0], t_ns[:0])) == 0
