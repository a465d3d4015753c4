"""Who is listened to: replays, strangers, reboots and keys that are replaced."""

from __future__ import annotations

import pytest

from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from tests.datagrams import KEY, boot, datagram, receiver
from tests.manual_clock import ManualClock


def test_replays_and_strangers_are_refused_and_counted() -> None:
    listening = receiver()
    first, second = wire.encode(datagram(0), KEY), wire.encode(datagram(1), KEY)
    assert listening.take(second)
    assert not listening.take(second)
    assert listening.take(first)  # out of order, and new
    assert not listening.take(first)
    assert listening.neighbours[2].refused.replay == 2
    assert not listening.take(wire.encode(datagram(3, sender=9), KEY))
    assert not listening.take(wire.encode(datagram(3, sender=1), KEY))
    assert not listening.take(wire.encode(datagram(3), b"x" * 32))
    assert not listening.take(b"noise")
    counters = listening.counters
    assert (counters.unknown_sender, counters.own, counters.malformed) == (1, 1, 1)
    assert listening.neighbours[2].refused.bad_key == 1
    assert listening.neighbours[2].accepted == 2


def test_a_reboot_starts_over() -> None:
    listening = receiver()
    assert listening.take(wire.encode(datagram(5, boot_id=boot(1)), KEY))
    assert listening.take(wire.encode(datagram(0, boot_id=boot(2)), KEY))
    assert len(listening.neighbours[2].poses()[0]) == 5  # nothing of the old clock is left


def test_a_robot_that_has_lost_its_count_is_named_once(caplog: pytest.LogCaptureFixture) -> None:
    listening = receiver()
    assert listening.take(wire.encode(datagram(5, boot_id=boot(7)), KEY))
    for counter in range(20):
        assert not listening.take(wire.encode(datagram(counter, boot_id=boot(1)), KEY))
    assert listening.neighbours[2].session.old_boots == 20
    (said,) = caplog.messages
    assert "older than one that was heard already" in said and "lost its state_dir" in said


def test_either_of_two_keys_is_valid_while_they_are_replaced() -> None:
    listening = NeighbourReceiver(1, {2: "beacon"}, {2: (KEY, b"n" * 32)}, ManualClock(5))
    assert listening.take(wire.encode(datagram(0), KEY))
    assert listening.take(wire.encode(datagram(1), b"n" * 32))
    assert not listening.take(wire.encode(datagram(2), b"o" * 32))
