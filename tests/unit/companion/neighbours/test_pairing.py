"""Packets find their other half, in whatever order both come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.core.clock import NS_PER_S
from companion.neighbours.clock_relation import ClockRelation
from companion.neighbours.pairing import Pairing
from tests.datagrams import datagram


def test_pairing_is_bounded_and_forgives_late_double_and_lost_batches() -> None:
    relation = ClockRelation(we_ping=True)
    pairing = Pairing(relation)
    sent = datagram(csi=15)
    for frame in range(60_000):
        pairing.add_forward(frame, frame * 8_000_000, frame)
    assert len(pairing._open) <= 2048
    frames = np.arange(59_000, 59_015, dtype=np.uint32)
    batch = replace(sent.csi, frame=frames, t_ns=frames.astype(np.int64) * 8_000_000 + 5)
    now_ns = 60_000 * 8_000_000
    pairing.add_reverse(batch, True, now_ns)
    pairing.add_reverse(batch, True, now_ns)  # again
    pairing.add_reverse(replace(batch, frame=frames - np.uint32(50_000)), True, now_ns)  # far too late
    assert pairing.paired == 15
    rate = pairing.rate(now_ns)
    assert rate == 0.0  # the newest seconds have nothing yet
    later = np.arange(59_200, 59_800, dtype=np.uint32)
    for start in range(0, 600, 15):
        part = later[start : start + 15]
        pairing.add_reverse(replace(batch, frame=part, t_ns=part.astype(np.int64) * 8_000_000), True, now_ns)
    rate = pairing.rate(now_ns)
    assert rate is not None
    assert 0.8 < rate <= 1.0
    assert Pairing(relation).rate(now_ns) is None


def test_a_reverse_channel_that_comes_before_its_packet_is_read_waits_for_it() -> None:
    """A service that stalled may find a datagram in one socket before it reads the packets in the other."""
    relation = ClockRelation(we_ping=True)
    pairing, sent, now_ns = Pairing(relation), datagram(csi=15), 100 * NS_PER_S
    frames = np.arange(50, dtype=np.uint32)
    for frame in frames.tolist():
        row = replace(sent.csi, frame=frames[frame : frame + 1], t_ns=np.array([now_ns + frame * 8_000_000]))
        pairing.add_reverse(row, True, now_ns + frame * 8_000_000)
    for frame in frames.tolist():
        pairing.add_forward(frame, now_ns + frame * 8_000_000 + 300_000, 0)
    assert pairing.paired == 50
    offset = relation.offset(now_ns + NS_PER_S)
    assert offset is not None
    assert abs(offset.offset_ns) < 50_000
    # The same counters an hour later are of another series.
    for frame in frames.tolist():
        row = replace(sent.csi, frame=frames[frame : frame + 1], t_ns=np.array([now_ns]))
        pairing.add_reverse(row, True, now_ns)
        pairing.add_forward(frame, now_ns + 3600 * NS_PER_S, 0)
    assert pairing.paired == 50
    for frame in range(3000):
        pairing.add_reverse(replace(sent.csi, frame=np.array([frame], np.uint32), t_ns=np.array([0])), True, now_ns)
    assert len(pairing._early) <= 2048
