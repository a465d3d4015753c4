"""What the team's process is told: raw, once, on our clock; and what it costs the event loop."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from companion.team.gathering import Gathering
from tests.datagrams import BASE_NS, KEY, KEYS, boot, datagram
from tests.manual_clock import ManualClock
from tests.unit.companion.neighbours.test_sightings import SEEN

LATE_NS = 3_000_000


def sent(number: int, sender: int, shift_ns: int) -> wire.Datagram:
    """The datagram of a tenth of a second, by a clock that is ahead by `shift_ns`."""
    t_ns = BASE_NS + number * NS_PER_S // 10
    poses = wire.PoseBatch(
        t_ns + shift_ns - np.arange(5)[::-1] * 20_000_000, np.full((5, 3), 0.01 * number), np.full(5, 3, np.uint8)
    )
    seen = replace(SEEN, number=number, target=1, t_ns=t_ns + shift_ns - NS_PER_S)
    one = replace(datagram(number, sender=sender, csi=0), sent_ns=t_ns + shift_ns, poses=poses)
    return replace(one, sightings=(seen, seen))


def heard(seconds: float, peers: int = 1, shift_ns: int = 7 * NS_PER_S) -> tuple[Gathering, NeighbourReceiver]:
    clock = ManualClock(BASE_NS)
    names = {2 + n: f"robot-{2 + n}" for n in range(peers)}
    receiver = NeighbourReceiver(1, names, dict.fromkeys(names, KEYS), clock)
    for number in range(round(seconds * 10)):
        clock.advance((BASE_NS + number * NS_PER_S // 10 + LATE_NS - clock.now_ns()) / NS_PER_S)
        for peer in names:
            assert receiver.take(wire.encode(sent(number, peer, shift_ns), KEY))
    return Gathering(1, boot(3), receiver.neighbours), receiver


def test_places_and_bearings_come_once_and_on_our_clock() -> None:
    gathering, _ = heard(2.0)
    news = gathering.news(BASE_NS + 2 * NS_PER_S)
    times = [t_ns for _, _, t_ns, _ in news.places]
    assert 9 <= len(times) <= 11
    # A datagram that took 3 ms makes its sender's clock seem 3 ms behind what it is.
    assert abs(times[-1] - (BASE_NS + 1_900_000_000 + LATE_NS)) < 250_000_000
    assert {robot for robot, *_ in news.places} == {2}
    assert [s.number for s in news.sightings[::2]] == list(range(20))
    assert news.sightings[0].t_ns == pytest.approx(BASE_NS - NS_PER_S + LATE_NS, abs=1_000_000)
    again = gathering.news(BASE_NS + 2 * NS_PER_S)
    assert (again.places, again.sightings) == ([], [])


def test_our_own_place_and_bearing_are_told_too() -> None:
    gathering, _ = heard(0.0)
    assert gathering.wants_place(BASE_NS)
    gathering.add_own_place(BASE_NS, np.array([1.0, 2.0, 3.0]))
    assert not gathering.wants_place(BASE_NS + 100_000_000)
    gathering.add_own_sighting(SEEN)
    news = gathering.news(BASE_NS)
    assert news.places == [(1, boot(3), BASE_NS, (1.0, 2.0, 3.0))]
    assert (news.sightings[0].observer, news.sightings[0].boot, news.sightings[0].t_ns) == (1, boot(3), SEEN.t_ns)


def test_a_second_of_four_neighbours_costs_the_loop_little() -> None:
    """Bounded: ten datagrams each, of which most poses are passed over."""
    gathering, _ = heard(1.0, peers=4)
    begun_s = time.thread_time()
    news = gathering.news(BASE_NS + NS_PER_S)
    assert time.thread_time() - begun_s < 0.02
    assert len(news.sightings) == 80
