"""How a neighbour is judged: standing, replay window, jumps, keys, pairing, persisted boots, lookalikes."""

from __future__ import annotations

import stat
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.cli import main
from companion.core.clock import NS_PER_S, ManualClock
from companion.errors import ConfigError
from companion.neighbours import wire
from companion.neighbours.boots import BootBook
from companion.neighbours.clock_relation import ClockRelation
from companion.neighbours.keys import read_key, write_key
from companion.neighbours.neighbour import Standing
from companion.neighbours.pairing import Pairing
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.session import Freshness, ReplayWindow, SenderSession
from companion.radio.traffic import Traffic, sent_bytes
from companion.sensing.lookalikes import Lookalikes
from tests.unit.companion.neighbours.test_wire import KEY, KEYS, boot, datagram


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


def test_each_counter_is_fresh_once_within_a_window() -> None:
    window = ReplayWindow()
    for counter in (5, 3, 70, 7, 8):
        assert window.is_fresh(counter)
        window.mark(counter)
    for counter in (5, 3, 70, 7, 8, 6, 0):  # 6 and 0 are too old to tell
        assert window.is_fresh(counter) is (counter == 6 and 70 - 6 < 64)
    assert window.is_fresh(69)
    assert window.is_fresh(10_000)


def test_an_old_boot_that_was_never_heard_live_is_a_replay_not_a_rival() -> None:
    session = SenderSession(None)
    for number in range(20):
        assert session.judge(boot(9), number, number * NS_PER_S) is Freshness.FRESH
        assert session.judge(boot(3), number, number * NS_PER_S) is Freshness.REPLAY
    assert session.rivals is None


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


def test_keys_are_private_and_never_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["companion", "keygen", str(tmp_path / "a.key"), str(tmp_path / "b.key")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    first = read_key(tmp_path / "a.key")
    assert len(first) == 32
    assert first != read_key(tmp_path / "b.key")
    assert stat.S_IMODE((tmp_path / "a.key").stat().st_mode) == 0o600
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert read_key(tmp_path / "a.key") == first
    (tmp_path / "a.key").chmod(0o640)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_key(tmp_path / "a.key")
    write_key(tmp_path / "c.key")
    (tmp_path / "c.key").write_bytes(b"short")
    with pytest.raises(ConfigError, match="at least 32"):
        read_key(tmp_path / "c.key")


def test_boot_numbers_rise_over_restarts_and_a_broken_book_is_fatal(tmp_path: Path) -> None:
    numbers = []
    for _ in range(3):
        book = BootBook(tmp_path)
        numbers.append(book.own_boot_id >> 32)
        book.note(2, boot(4), 17)
        book.close()
    assert numbers == [1, 2, 3]
    reached = BootBook(tmp_path).reached(2)
    assert reached is not None
    assert (reached.boot_id, reached.ceiling) == (boot(4), 67)
    content = msgspec.json.decode((tmp_path / "boots.json").read_bytes())
    assert content["own"] == 4
    (tmp_path / "boots.json").write_text("{")
    with pytest.raises(ConfigError, match="new keys"):
        BootBook(tmp_path)
    with pytest.raises(ConfigError, match="cannot be written"):
        BootBook(Path("/proc/nowhere"))


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


def test_one_transmitter_behind_two_names_is_reported_after_several_apertures() -> None:
    rng = np.random.default_rng(1)

    def profile(seed: int, noise: float = 0.02) -> bytes:
        peak = np.zeros((180, 360))
        row, column = 40 + 17 * seed, 30 + 61 * seed
        peak[row - 8 : row + 8, column - 8 : column + 8] = 1.0
        return (peak + noise * rng.random((180, 360))).astype(np.float16).tobytes()

    looks = Lookalikes({2: "a", 3: "b", 4: "c"})
    for number in range(3):
        assert looks.pairs() == ()
        looks.add(2, number, profile(1))
        doubt = looks.add(3, number, profile(1))
        looks.add(4, number, profile(3))
    assert looks.pairs() == (("a", "b"),)
    assert "that of a" in doubt
    looks.add(2, 9, profile(1))
    assert looks.add(3, 9, profile(2)) == ""
    assert looks.pairs() == ()
    assert looks.add(4, 10, b"") == ""


def test_traffic_of_a_real_interface_is_counted_and_a_missing_one_left_out() -> None:
    traffic = Traffic(["lo", "nosuch0", None])
    before = sent_bytes("lo")
    assert before is not None
    assert traffic.bytes_per_s(0) == {}
    rates = traffic.bytes_per_s(NS_PER_S)
    assert list(rates) == ["lo"]
    assert rates["lo"] >= 0
    assert sent_bytes("nosuch0") is None
