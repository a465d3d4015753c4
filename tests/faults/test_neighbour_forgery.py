"""Hostile datagrams: forged (fault 20), replayed after both ends rebooted (21), two robots with one name (30)."""

from __future__ import annotations

import random
import socket
import time
from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.schema import Config, CsiConfig, NeighbourConfig
from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.boots import BootBook
from companion.neighbours.link import Link
from companion.neighbours.neighbour import Standing
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from companion.sim.stage import free_udp_port
from tests.datagrams import KEY, KEYS, boot, datagram
from tests.faults.campaigns import runs
from tests.faults.figures import record as note
from tests.manual_clock import ManualClock
from tests.mutation import mutant

SEED = 20
MUTANTS = runs(10_000, 1_000_000)


def receiver(clock: ManualClock, book: BootBook | None = None) -> NeighbourReceiver:
    return NeighbourReceiver(1, {2: "beacon"}, {2: KEYS}, clock, book=book)


def test_fault_20_no_forgery_is_accepted() -> None:
    rng, listening = random.Random(SEED), receiver(ManualClock(5))
    originals = [wire.encode(datagram(number, csi=number % 20, poses=number % 6), KEY) for number in range(20)]
    for number in range(MUTANTS):
        original = originals[number % len(originals)]
        kind = rng.randrange(3)
        if kind == 0:
            forged = mutant(original, rng)
        elif kind == 1:  # a body that was never signed under a tag that was
            forged = mutant(original[:-16], rng) + original[-16:]
        else:
            forged = wire.encode(datagram(number), rng.randbytes(32)) if number % 50 == 0 else rng.randbytes(120)
        assert forged in originals or not listening.take(forged), forged.hex()
    neighbour, link = listening.neighbours[2], listening.counters
    refused = neighbour.refused.bad_key + neighbour.refused.malformed
    refused += link.malformed + link.version + link.unknown_sender + link.own
    assert neighbour.accepted == 0
    assert refused > 0.99 * MUTANTS
    assert neighbour.refused.bad_key > MUTANTS // 4
    note(20, "forged datagrams", forgeries=MUTANTS, accepted=0)


def test_fault_20_a_good_key_does_not_excuse_a_broken_datagram() -> None:
    """What a robot with the key and a fault in its program sends is refused or taken, and breaks nothing."""
    rng, clock = random.Random(SEED), ManualClock(5)
    listening = receiver(clock)
    beacon, mutants = listening.neighbours[2], runs(3_000, 300_000)
    originals = [datagram(csi=n % 20, poses=n % 6) for n in range(40)]
    for number in range(mutants):
        echo = wire.Echo(1, rng.randrange(1 << 32), rng.randrange(1 << 20))
        data = wire.encode(replace(originals[number % 40], counter=number, echo=echo), KEY)
        clock.advance(0.02)
        # Behind the counter, so that it is not a replay.
        listening.take(wire.signed(data[:24] + mutant(data[24:-16], rng), KEY))
        if number % 50 == 0:
            now_ns = clock.now_ns()
            beacon.add_forward(number % 19, now_ns, number)
            beacon.relate_uncounted(now_ns)
            beacon.poses()
            beacon.health(now_ns)
    assert beacon.accepted > mutants // 10
    assert beacon.refused.malformed > mutants // 2
    note(20, "broken datagrams with a good key", mutants=mutants, taken=beacon.accepted, errors=0)


def test_fault_20_a_flood_of_forgeries_costs_little_of_a_core(tmp_path: Path) -> None:
    """Ten thousand a second through the socket; judged generously, since machines are noisy."""
    config = Config(
        role="beacon",
        id=1,
        name="us",
        csi=CsiConfig(108),
        neighbours=NeighbourConfig(key_file="k", port=free_udp_port("127.255.255.255")),
        peers=[],
    )
    link, listening = Link(config), receiver(ManualClock(5))
    forged = wire.encode(datagram(), b"x" * 32)
    count, batch = runs(5_000, 50_000), 100
    taken, used_s = 0, 0.0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        for _ in range(count // batch):
            for _ in range(batch):
                sender.sendto(forged, (config.neighbours.broadcast, config.neighbours.port))
            start_s = time.thread_time()
            for data in link.drain():
                taken += 1
                assert not listening.take(data)
            used_s += time.thread_time() - start_s
    link.close()
    assert taken > 0.9 * count
    share = 10_000 * used_s / taken
    assert share < 0.5
    note(20, "flood of forgeries", datagrams=taken, share_of_a_core_at_10k_per_s=share)


def test_fault_21_a_replayed_capture_is_refused_though_both_ends_rebooted(tmp_path: Path) -> None:
    clock = ManualClock(5)
    sender_book = BootBook(tmp_path / "sender")
    first = _captured(sender_book, 80)
    book = BootBook(tmp_path / "receiver")
    listening = receiver(clock, book)
    assert sum(map(listening.take, first)) == 80
    assert sum(map(listening.take, first)) == 0
    book.close()
    sender_book.close()
    # The receiver alone comes back: the sender goes on where it was, the capture does not count again.
    book = BootBook(tmp_path / "receiver")
    listening = receiver(clock, book)
    assert sum(map(listening.take, first)) == 0
    book.close()
    # Both come back.
    sender_book = BootBook(tmp_path / "sender")
    second = _captured(sender_book, 40)
    book = BootBook(tmp_path / "receiver")
    listening = receiver(clock, book)
    accepted = sum(listening.take(data) for data in [*first, *second, *first, *second])
    assert accepted == 40
    assert listening.neighbours[2].refused.replay == 200
    assert listening.neighbours[2].standing(clock.now_ns()) is not Standing.REFUSED
    book.close()
    sender_book.close()
    note(21, "replayed capture", resent=320, accepted_twice=0)


def test_fault_21_a_crash_costs_seconds_of_datagrams_never_a_replay(tmp_path: Path) -> None:
    """The receiver dies without closing anything: what is on disk is a ceiling."""
    clock = ManualClock(5)
    sender_book = BootBook(tmp_path / "sender")
    data = _captured(sender_book, 300)
    sender_book.close()
    book = BootBook(tmp_path / "receiver")
    listening = receiver(clock, book)
    assert all(map(listening.take, data[:150]))
    book.close()
    book = BootBook(tmp_path / "receiver")
    again = receiver(clock, book)
    assert sum(map(again.take, data[:150])) == 0
    missed = sum(not again.take(one) for one in data[150:])
    book.close()
    assert 0 < missed <= 50
    note(21, "crash of the receiver", accepted_twice=0, datagrams_refused_after=missed)


def test_fault_30_two_robots_with_one_identity_are_both_refused_and_named(caplog: pytest.LogCaptureFixture) -> None:
    clock = ManualClock(5)
    listening = receiver(clock)
    accepted_late = 0
    for number in range(40):
        for boot_id in (boot(5), boot(6)):
            clock.advance(0.05)
            accepted = listening.take(wire.encode(datagram(number, boot_id), KEY))
            accepted_late += accepted and number >= 4
    neighbour = listening.neighbours[2]
    assert accepted_late == 0
    assert neighbour.standing(clock.now_ns()) is Standing.REFUSED
    assert neighbour.refused.duplicate_identity > 60
    assert f"{boot(5):016x}" in caplog.text
    assert f"{boot(6):016x}" in caplog.text
    # One of them leaves; the other is believed again.
    for number in range(40, 240):
        clock.advance(0.1)
        accepted = listening.take(wire.encode(datagram(number, boot(6)), KEY))
    assert accepted
    note(30, "two robots, one identity", accepted_of_either=0, log_names_both="yes")


def test_fault_30_copies_of_one_disk_are_two_robots_as_well() -> None:
    clock = ManualClock(5)
    listening = receiver(clock)
    twin = boot(5) ^ 0x1234  # the same number, another random part
    accepted = 0
    for number in range(30):
        for boot_id in (boot(5), twin):
            clock.advance(0.05)
            accepted += listening.take(wire.encode(datagram(number, boot_id), KEY)) and number >= 4
    assert accepted == 0


def test_fault_30_a_one_way_switch_is_a_reboot() -> None:
    clock = ManualClock(5)
    listening = receiver(clock)
    for boot_id in (boot(5), boot(6), boot(7)):
        for number in range(20):
            clock.advance(0.1)
            assert listening.take(wire.encode(datagram(number, boot_id), KEY))
        # A straggler of the boot before is old news, no rival.
        listening.take(wire.encode(datagram(20, boot_id), KEY))
    assert listening.neighbours[2].standing(clock.now_ns()) is not Standing.REFUSED
    assert listening.neighbours[2].boots == 3


def _captured(book: BootBook, count: int) -> list[bytes]:
    sender = NeighbourSender(role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=book.own_boot_id)
    made = []
    for number in range(count):
        t_ns = (number + 10) * NS_PER_S // 10
        sender.add_pose(t_ns, (0.0, 0.0, 0.0), 3)
        made += sender.datagrams(t_ns + 1)
    return made
