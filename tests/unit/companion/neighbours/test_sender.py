"""What a sender puts into its datagrams, and how much of it."""

from __future__ import annotations

import numpy as np

from companion.neighbours import wire
from companion.neighbours.sender import NeighbourSender
from tests.datagrams import BASE_NS, KEY, boot, receiver


def flood(sender: NeighbourSender, seconds: int, packets_per_s: int) -> list[bytes]:
    """What a sender makes of so much CSI and poses at 200 Hz, asked ten times a second."""
    made, csi = [], np.full(30, 20 + 5j, np.complex64)
    for step in range(seconds * 1000):
        t_ns = BASE_NS + step * 1_000_000
        if step % 5 == 0 and sender.wants_pose(t_ns):
            sender.add_pose(t_ns, (0.0, 0.0, 0.0), 3)
        if step * packets_per_s // 1000 != (step + 1) * packets_per_s // 1000:
            sender.add_channel(step, t_ns, step * 1000, csi, power_dbm=-55.0, antenna=0)
        if step % 100 == 99:
            made += sender.datagrams(t_ns)
    return made


def test_a_beacon_stays_under_5_kilobytes_a_second() -> None:
    sender = NeighbourSender(role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=boot(1))
    listening = receiver()
    data = flood(sender, 10, 150)
    assert all(map(listening.take, data))
    assert sum(map(len, data)) + wire.FRAME_BYTES * len(data) == sender.sent_bytes
    assert sender.sent_bytes / 10 < 5000
    assert (sender.dropped, sender.thinned) == (0, 0)
    assert len(listening.neighbours[2].channels_since(0)) == 1500
    assert len(listening.neighbours[2].poses()[0]) in range(490, 511)


def test_more_packets_than_the_budget_are_thinned_evenly_not_sent() -> None:
    sender = NeighbourSender(role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=boot(1))
    listening = receiver()
    data = flood(sender, 10, 400)
    assert all(map(listening.take, data))
    assert sender.sent_bytes < 5000 * (10 + 0.1)  # what a quiet moment saves included
    kept = listening.neighbours[2].channels_since(0)
    assert sender.thinned + len(kept) == 4000
    assert np.diff(kept.frame.astype(int)).max() < 60


def test_a_restarted_counter_and_a_wild_pose_cost_only_themselves() -> None:
    sender = NeighbourSender(role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=boot(1))
    listening = receiver()
    csi = np.full(30, 20 + 5j, np.complex64)
    for frame in (900_000, 900_001, 1, 2):
        sender.add_channel(frame, BASE_NS, 17, csi, power_dbm=-55.0, antenna=0)
    first, second = sender.datagrams(BASE_NS + 1)
    assert listening.take(first)
    assert listening.take(second)
    assert listening.neighbours[2].channels_since(0).frame.tolist() == [900_000, 900_001, 1, 2]
    sender.add_pose(BASE_NS, (0.0, 0.0, 0.0), 3)
    sender.add_pose(BASE_NS, (50.0, 0.0, 0.0), 3)
    assert sender.datagrams(BASE_NS + 2) == []
    assert sender.dropped == 2
