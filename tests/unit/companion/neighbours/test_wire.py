"""The neighbours' datagram: what goes in comes out, anything else is refused, and it stays small."""

from __future__ import annotations

import hashlib
import hmac

import numpy as np
import pytest

from companion.core.clock import NS_PER_S, ManualClock
from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from wsr.reduced import reduce_channel, restore_channel

KEY = b"k" * 32
KEYS = (KEY,)
BASE_NS = 1_000 * NS_PER_S


def boot(number: int) -> int:
    return number << 32 | 0xABCD


def datagram(
    counter: int = 0, boot_id: int = boot(7), sender: int = 2, poses: int = 5, csi: int = 15, seed: int = 0
) -> wire.Datagram:
    rng = np.random.default_rng(seed)
    values = (rng.normal(size=(csi, 30)) + 1j * rng.normal(size=(csi, 30))).astype(np.complex64) * 30
    coefficients, scale = reduce_channel(values)
    return wire.Datagram(
        role=wire.Role.BEACON,
        sender=sender,
        boot_id=boot_id,
        counter=counter,
        sent_ns=BASE_NS + NS_PER_S // 2,
        poses=wire.PoseBatch(
            BASE_NS + np.arange(poses) * 20_000_000,
            100.0 + rng.normal(0, 0.1, (poses, 3)),
            np.full(poses, 3, np.uint8),
        ),
        csi=wire.CsiBatch(
            np.arange(csi, dtype=np.uint32) + 4_294_967_290,
            BASE_NS + np.arange(csi) * 6_000_000,
            np.arange(csi, dtype=np.uint32) * 6000 + 4_294_900_000,
            coefficients,
            scale,
            np.arange(csi, dtype=np.int8) - 60,
            (np.arange(csi) % 3).astype(np.uint8),
        ),
    )


def test_round_trip_keeps_a_tenth_of_a_millimetre_and_every_coefficient() -> None:
    sent = datagram()
    got = wire.decode(wire.encode(sent, KEY), KEYS)
    for name in ("role", "sender", "boot_id", "counter", "sent_ns", "counted"):
        assert getattr(got, name) == getattr(sent, name)
    assert np.abs(got.poses.t_ns - sent.poses.t_ns).max() <= 50_000
    np.testing.assert_allclose(got.poses.p_enu_m, sent.poses.p_enu_m, atol=0.5e-4 + 1e-9)
    np.testing.assert_array_equal(got.poses.confidence, sent.poses.confidence)
    np.testing.assert_array_equal(got.csi.t_ns, sent.csi.t_ns)
    for name in ("frame", "nic_us", "coefficients", "scale", "power_dbm", "antenna"):
        np.testing.assert_array_equal(getattr(got.csi, name), getattr(sent.csi, name), name)
    assert restore_channel(got.csi.coefficients, got.csi.scale).shape == (15, 30)


@pytest.mark.parametrize(("poses", "csi"), [(0, 1), (1, 0), (0, 0), (wire.MAX_POSES, wire.MAX_CSI)])
def test_every_size_fits_one_ethernet_frame(poses: int, csi: int) -> None:
    data = wire.encode(datagram(poses=poses, csi=csi), KEY)
    assert len(data) <= 1472
    got = wire.decode(data, KEYS)
    assert len(got.poses.t_ns) == poses
    assert len(got.csi.frame) == csi


def test_more_than_fits_is_the_callers_mistake() -> None:
    with pytest.raises(ValueError, match="at most"):
        wire.encode(datagram(csi=wire.MAX_CSI + 1), KEY)


def test_any_flipped_bit_is_refused() -> None:
    data = wire.encode(datagram(), KEY)
    for position in range(len(data)):
        forged = bytearray(data)
        forged[position] ^= 1 << position % 8
        with pytest.raises(wire.WireError):
            wire.decode(bytes(forged), KEYS)


def test_a_signed_datagram_of_wrong_length_is_refused() -> None:
    body = wire.encode(datagram(), KEY)[:-16] + b"more"
    with pytest.raises(wire.WireError, match="expected"):
        wire.decode(body + hmac.digest(KEY, body, hashlib.sha256)[:16], KEYS)


def test_another_version_is_named() -> None:
    data = bytearray(wire.encode(datagram(), KEY))
    for version, older in ((9, "update this robot"), (2, "update robot 2")):
        data[4] = version
        with pytest.raises(wire.VersionError, match=f"robot 2 speaks wire version {version}, .*{older}"):
            wire.decode(bytes(data), KEYS)


def receiver() -> NeighbourReceiver:
    return NeighbourReceiver(1, {2: "beacon"}, {2: KEYS}, ManualClock(5))


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


def flood(sender: NeighbourSender, seconds: int, packets_per_s: int) -> list[bytes]:
    """What a sender makes of so much CSI and poses at 200 Hz, asked ten times a second."""
    made, csi = [], np.full(30, 20 + 5j, np.complex64)
    for step in range(seconds * 1000):
        t_ns = BASE_NS + step * 1_000_000
        if step % 5 == 0 and sender.wants_pose(t_ns):
            sender.add_pose(t_ns, (0.0, 0.0, 0.0), 3)
        if step * packets_per_s // 1000 != (step + 1) * packets_per_s // 1000:
            sender.add_channel(step, t_ns, step * 1000, csi, -55.0, 0)
        if step % 100 == 99:
            made += sender.datagrams(t_ns)
    return made


def test_a_beacon_stays_under_5_kilobytes_a_second() -> None:
    sender = NeighbourSender(wire.Role.BEACON, 2, KEY, pose_rate_hz=50, boot_id=boot(1))
    listening = receiver()
    data = flood(sender, 10, 150)
    assert all(map(listening.take, data))
    assert sum(map(len, data)) + wire.FRAME_BYTES * len(data) == sender.sent_bytes
    assert sender.sent_bytes / 10 < 5000
    assert (sender.dropped, sender.thinned) == (0, 0)
    assert len(listening.neighbours[2].channels_since(0)) == 1500
    assert len(listening.neighbours[2].poses()[0]) in range(490, 511)


def test_more_packets_than_the_budget_are_thinned_evenly_not_sent() -> None:
    sender = NeighbourSender(wire.Role.BEACON, 2, KEY, pose_rate_hz=50, boot_id=boot(1))
    listening = receiver()
    data = flood(sender, 10, 400)
    assert all(map(listening.take, data))
    assert sender.sent_bytes < 5000 * (10 + 0.1)  # what a quiet moment saves included
    kept = listening.neighbours[2].channels_since(0)
    assert sender.thinned + len(kept) == 4000
    assert np.diff(kept.frame.astype(int)).max() < 60


def test_a_restarted_counter_and_a_wild_pose_cost_only_themselves() -> None:
    sender = NeighbourSender(wire.Role.BEACON, 2, KEY, pose_rate_hz=50, boot_id=boot(1))
    listening = receiver()
    csi = np.full(30, 20 + 5j, np.complex64)
    for frame in (900_000, 900_001, 1, 2):
        sender.add_channel(frame, BASE_NS, 17, csi, -55.0, 0)
    first, second = sender.datagrams(BASE_NS + 1)
    assert listening.take(first)
    assert listening.take(second)
    assert listening.neighbours[2].channels_since(0).frame.tolist() == [900_000, 900_001, 1, 2]
    sender.add_pose(BASE_NS, (0.0, 0.0, 0.0), 3)
    sender.add_pose(BASE_NS, (50.0, 0.0, 0.0), 3)
    assert sender.datagrams(BASE_NS + 2) == []
    assert sender.dropped == 2


def test_either_of_two_keys_is_valid_while_they_are_replaced() -> None:
    listening = NeighbourReceiver(1, {2: "beacon"}, {2: (KEY, b"n" * 32)}, ManualClock(5))
    assert listening.take(wire.encode(datagram(0), KEY))
    assert listening.take(wire.encode(datagram(1), b"n" * 32))
    assert not listening.take(wire.encode(datagram(2), b"o" * 32))
