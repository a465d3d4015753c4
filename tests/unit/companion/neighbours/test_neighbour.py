"""How a neighbour is judged: its standing, and jumps of its position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.neighbour import Standing
from companion.neighbours.receiver import NeighbourReceiver
from tests.datagrams import KEY, KEYS, datagram
from tests.manual_clock import ManualClock


def listening(clock: ManualClock) -> NeighbourReceiver:
    return NeighbourReceiver(1, {2: "beacon"}, {2: KEYS}, clock)


def test_a_neighbour_goes_from_unheard_to_lost() -> None:
    clock = ManualClock(100 * NS_PER_S)
    receiver = listening(clock)
    beacon = receiver.neighbours[2]
    assert beacon.standing(clock.now_ns()) is Standing.UNHEARD
    assert not receiver.take(wire.encode(datagram(0), b"x" * 32))
    assert beacon.standing(clock.now_ns()) is Standing.REFUSED
    assert "key" in beacon.refusal
    assert receiver.take(wire.encode(datagram(0), KEY))
    assert beacon.standing(clock.now_ns()) is Standing.DISCOVERED
    for frame in range(50):
        beacon.relation.add_exchange(clock.now_ns() + frame, clock.now_ns() + frame + 7)
    beacon.relation._sent.clear()  # the datagram's own time of sending has nothing to do with this clock
    assert beacon.standing(clock.now_ns()) is Standing.TRACKED
    clock.advance(2.5)
    assert beacon.standing(clock.now_ns()) is Standing.STALE
    clock.advance(10)
    assert beacon.standing(clock.now_ns()) is Standing.LOST
    health = beacon.health(clock.now_ns())
    assert health["state"] == "lost"
    assert health["refused"]["bad_key"] == 1


def test_an_impossible_jump_is_refused_until_it_has_settled() -> None:
    clock = ManualClock(5)
    receiver = listening(clock)
    beacon = receiver.neighbours[2]

    def at(number: int, x_m: float) -> bool:
        sent = datagram(number)
        poses = wire.PoseBatch(sent.poses.t_ns + number * 100_000_000, np.full((5, 3), x_m), sent.poses.confidence)
        return receiver.take(wire.encode(replace(sent, poses=poses, sent_ns=sent.sent_ns + number * 100_000_000), KEY))

    assert all(at(number, 1.0 + 0.1 * number) for number in range(5))
    assert not at(5, 40.0)
    assert at(6, 1.6)  # it was one wild datagram
    answers = [at(number, 40.0) for number in range(7, 15)]
    assert answers == [False] * 4 + [True] * 4
    assert beacon.refused.impossible_jump == 5
    assert len(beacon.poses()[0]) == 20  # nothing of the time before the step


def test_a_datagram_that_waited_was_heard_when_it_arrived() -> None:
    clock = ManualClock(100 * NS_PER_S)
    told: list[tuple[int, int, int]] = []
    receiver = NeighbourReceiver(1, {2: "beacon"}, {2: KEYS}, clock, on_accepted=lambda *one: told.append(one))
    arrived_ns = clock.now_ns() - 15_000_000
    sent = datagram(0)
    assert receiver.take(wire.encode(sent, KEY), arrived_ns)
    beacon = receiver.neighbours[2]
    assert beacon.heard_ns == arrived_ns and beacon.received[0][0] == arrived_ns
    assert told == [(2, sent.sent_ns, arrived_ns)], "what it is told of the way back bounds its clock too"
