"""The relation of two robots' clocks: over a lossy network (fault 22), with broken counters (24), without counters."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.neighbour import Standing
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from tests.datagrams import KEY, KEYS, boot
from tests.faults.figures import record as note
from tests.leg_scene import Scene
from tests.manual_clock import ManualClock

OFFSET_NS = 56 * NS_PER_S + 370_000_000
CSI = np.full(30, 20 + 5j, np.complex64)


class Pair:
    """A drone that pings at 120/s and a beacon whose clock is another: what each stamps, and datagrams both ways."""

    def __init__(self, notes_ages: bool = False) -> None:
        self.rng = random.Random(1)
        self.clock = ManualClock(100 * NS_PER_S)
        self.receiver = NeighbourReceiver(1, {2: "beacon"}, {2: KEYS}, self.clock)
        self.sender = NeighbourSender(role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=boot(1))
        self.beacon = self.receiver.neighbours[2]
        self.beacon_clock = ManualClock(100 * NS_PER_S + OFFSET_NS)
        self.there = NeighbourReceiver(
            2, {1: "uav"}, {1: KEYS}, self.beacon_clock, we_ping=False, on_accepted=self.sender.add_heard
        )
        self.ours = NeighbourSender(role=wire.Role.UAV, own_id=1, key=KEY, pose_rate_hz=50, boot_id=boot(1))
        self.on_the_way: list[tuple[int, NeighbourReceiver, bytes]] = []
        self.frame = 0
        self.notes_ages = notes_ages
        self.ages: list[tuple[float, float]] = []
        """Of the newest data, as said and true [s], when something arrived and each 10 ms."""

    def run(
        self, seconds: float, loss: float = 0.0, delay_s: float = 0.001, jitter_s: float = 0.0,
        duplicates: float = 0.0, counter_error: int = 0,
    ) -> None:  # fmt: skip
        """`counter_error`: the beacon's counters are wrong by up to so much, another amount each time."""
        for step in range(round(seconds * 1000)):
            self.clock.advance(0.001)
            self.beacon_clock.advance(0.001)
            now_ns = self.clock.now_ns()
            if step % 8 == 0:
                self.frame += 1
                turnaround_ns = 300_000 + round(self.rng.gauss(0, 20_000))
                theirs_ns = now_ns - turnaround_ns + OFFSET_NS
                self.beacon.add_forward(self.frame, now_ns, (now_ns // 1000) & 0xFFFFFFFF)
                shown = max(1, self.frame + self.rng.randint(-counter_error, counter_error))
                self.sender.add_channel(
                    shown, theirs_ns, theirs_ns // 1000 & 0xFFFFFFFF, CSI, power_dbm=-50.0, antenna=0
                )
            sent: list[tuple[NeighbourReceiver, bytes]] = []
            if step % 100 == 99:
                sent += [(self.receiver, data) for data in self.sender.datagrams(now_ns + OFFSET_NS)]
            if step % 100 == 49:
                self.ours.add_pose(now_ns, (0.0, 0.0, 0.0), 3)
                sent += [(self.there, data) for data in self.ours.datagrams(now_ns)]
            for to, data in sent:
                for _ in range(1 + (self.rng.random() < duplicates)):
                    if self.rng.random() >= loss:
                        late_s = max(0.0, delay_s + self.rng.uniform(-jitter_s, jitter_s))
                        self.on_the_way.append((now_ns + round(late_s * NS_PER_S), to, data))
            arrived = [item for item in self.on_the_way if item[0] <= now_ns]
            self.on_the_way = [item for item in self.on_the_way if item[0] > now_ns]
            for _, to, data in sorted(arrived, key=lambda item: self.rng.random()):
                to.take(data)
            # Between two datagrams what is said grows with what is true.
            if self.notes_ages and (arrived or step % 10 == 0):
                age_s = self.beacon.data_age_s(now_ns)
                assert age_s is not None or not self.ages
                if age_s is None:
                    continue
                newest_ns = max(d.sent_ns for _, d in self.beacon.received)
                self.ages.append((age_s, (now_ns + OFFSET_NS - newest_ns) / NS_PER_S))


def test_fault_22_the_age_of_data_is_right_over_a_lossy_network() -> None:
    pair = Pair(notes_ages=True)
    pair.run(20.0, loss=0.2, delay_s=0.02, jitter_s=0.01, duplicates=0.1)
    said, true = np.array(pair.ages).T
    worst_ms = 1e3 * float(np.abs(said - true).max())
    assert len(said) > 2_000
    assert worst_ms < 5.0
    assert pair.beacon.standing(pair.clock.now_ns()) is Standing.TRACKED
    assert pair.beacon.refused.replay > 0  # the duplicates
    rate = pair.beacon.pairing.rate(pair.clock.now_ns())
    assert rate is not None
    assert 0.6 < rate < 0.97
    note(22, "age of data, 20 % lost, 20 +- 10 ms", worst_error_ms=worst_ms, pairing_rate=rate)


def test_fault_22_the_bearing_stays_within_a_fifth_of_the_clean_one() -> None:
    rng = random.Random(22)
    scenes = [Scene(math.radians(azimuth)) for azimuth in (-130, 10, 45, 100)]
    clean = [scene.error_deg(scene.cut()) for scene in scenes]
    lossy = []
    for scene in scenes:
        kept = [data for data in scene.datagrams if rng.random() >= 0.2]
        kept += [data for data in kept if rng.random() < 0.1]
        # 20 +- 10 ms apart at ten a second: neighbours may overtake each other, no more.
        order = sorted(range(len(kept)), key=lambda i: i + rng.uniform(-0.6, 0.6))
        lossy.append(scene.error_deg(scene.cut(datagrams=[kept[i] for i in order])))
    assert np.mean(lossy) < 1.2 * np.mean(clean) + 0.3
    note(22, "AOA error over the same network", clean_deg=float(np.mean(clean)), lossy_deg=float(np.mean(lossy)))


def test_fault_24_scattered_counters_leave_the_relation_unlocked_and_it_says_why() -> None:
    pair = Pair()
    assert "no shared exchanges" in pair.beacon.not_locked(pair.clock.now_ns())
    pair.run(6.0)
    assert pair.beacon.not_locked(pair.clock.now_ns()) == ""
    pair.run(6.0, counter_error=5)
    reason = pair.beacon.not_locked(pair.clock.now_ns())
    assert "uncertain by" in reason
    assert "at most 5 wanted" in reason
    assert pair.beacon.standing(pair.clock.now_ns()) is Standing.DISCOVERED
    pair.run(6.0)
    assert pair.beacon.not_locked(pair.clock.now_ns()) == ""
    note(24, "counters scattered by +-5", says=reason.split(": ")[-1])


@pytest.mark.parametrize("jitter_s", [0.0, 0.01])
@pytest.mark.parametrize("shift", [-4, 4])
def test_fault_24_shifted_counters_are_never_taken_for_a_clock_that_is_right(shift: int, jitter_s: float) -> None:
    """All counters off by a few, so that the exchanges agree with each other: by that offset datagrams would arrive
    before they were sent, theirs here or ours there."""
    pair = Pair()
    pair.frame = 100
    original = pair.sender.add_channel
    pair.sender.add_channel = lambda frame, *rest, **more: original(frame + shift, *rest, **more)  # type: ignore[method-assign]
    pair.run(8.0, delay_s=0.001 + jitter_s, jitter_s=jitter_s)
    offset = pair.beacon.relation.offset(pair.clock.now_ns())
    assert offset is not None
    error_ns = abs(offset.offset_ns - OFFSET_NS)
    assert error_ns > 20_000_000
    assert not offset.is_locked
    assert "is not related to ours: uncertain by" in pair.beacon.not_locked(pair.clock.now_ns())
    # It says how far off it may be to the time that the fastest datagrams take, and never that it is nearer.
    assert offset.round_trip_ns is not None
    assert error_ns - offset.round_trip_ns - 1_000_000 < offset.uncertainty_ns < error_ns + 1_000_000
    assert pair.beacon.standing(pair.clock.now_ns()) is Standing.DISCOVERED
    if not jitter_s:
        note(
            24,
            f"counters shifted by {shift}",
            error_ms=error_ns * 1e-6,
            says_uncertain_by_ms=offset.uncertainty_ns * 1e-6,
            locked=str(offset.is_locked),
        )


def test_an_echo_every_few_seconds_is_enough() -> None:
    """As with many neighbours, each echoed in turn: less often than the exchanges that are kept reach back."""
    pair = Pair()
    pair.frame = 100
    original, echo = pair.sender.add_channel, pair.sender._echo
    pair.sender.add_channel = lambda frame, *rest, **more: original(frame - 4, *rest, **more)  # type: ignore[method-assign]
    turn = iter(range(10_000))
    pair.sender._echo = lambda now_ns: echo(now_ns) if next(turn) % 40 == 0 else None  # type: ignore[method-assign]
    pair.run(3.0)
    for _ in range(50):
        pair.run(0.1)
        assert pair.beacon.not_locked(pair.clock.now_ns())


def test_a_shift_is_believed_only_where_nobody_says_what_arrives_there() -> None:
    """One way alone cannot show a shift towards later: datagrams might be that slow."""
    pair = Pair()
    pair.frame = 100
    pair.there.neighbours.clear()  # the beacon hears nothing of us
    original = pair.sender.add_channel
    pair.sender.add_channel = lambda frame, *rest, **more: original(frame - 4, *rest, **more)  # type: ignore[method-assign]
    pair.run(5.0)
    offset = pair.beacon.relation.offset(pair.clock.now_ns())
    assert offset is not None
    assert offset.round_trip_ns is None
    assert offset.is_locked


def test_an_echo_of_an_earlier_boot_bounds_nothing() -> None:
    pair = Pair()
    pair.run(3.0)
    now_ns = pair.clock.now_ns()
    before = pair.beacon.relation.offset(now_ns)
    pair.beacon.take_echo(wire.Echo(1, (now_ns // 1000 - 3_600_000_000) & 0xFFFFFFFF, 0), now_ns, now_ns)
    pair.beacon.take_echo(wire.Echo(1, (now_ns // 1000 + 10) & 0xFFFFFFFF, 0), now_ns, now_ns)
    assert pair.beacon.relation.offset(now_ns) == before
