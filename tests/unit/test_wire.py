"""The neighbours' datagram: what goes in comes out, anything else is refused, and it stays small."""

from __future__ import annotations

import hashlib
import hmac

import numpy as np
import pytest

from companion import wire
from companion.clock import NS_PER_S, ManualClock
from companion.neighbours import NeighbourReceiver, NeighbourSender

KEY = b"k" * 32
BASE_NS = 1_000 * NS_PER_S


def datagram(counter: int = 0, boot_id: int = 7, sender: int = 2, poses: int = 5, csi: int = 15) -> wire.Datagram:
    rng = np.random.default_rng(counter)
    return wire.Datagram(
        wire.Role.BEACON,
        sender,
        boot_id,
        counter,
        wire.PoseBatch(
            BASE_NS + np.arange(poses) * 20_000_000, rng.normal(0, 10, (poses, 3)), np.full(poses, 3, np.uint8)
        ),
        wire.CsiBatch(
            np.arange(csi, dtype=np.uint32) + 4_294_967_290,
            BASE_NS + np.arange(csi) * 6_000_000,
            np.arange(csi, dtype=np.uint32),
            (rng.normal(size=csi) + 1j * rng.normal(size=csi)).astype(np.complex64) * 30,
            np.zeros(csi, np.uint8),
        ),
    )


def test_round_trip_keeps_a_tenth_of_a_millimetre_and_the_phase() -> None:
    sent = datagram()
    got = wire.decode(wire.encode(sent, KEY), KEY)
    assert (got.role, got.sender, got.boot_id, got.counter) == (sent.role, sent.sender, sent.boot_id, sent.counter)
    np.testing.assert_array_equal(got.poses.t_ns, sent.poses.t_ns)
    np.testing.assert_allclose(got.poses.p_enu_m, sent.poses.p_enu_m, atol=0.5e-4 + 1e-9)
    np.testing.assert_array_equal(got.csi.frame, sent.csi.frame)
    np.testing.assert_array_equal(got.csi.t_ns, sent.csi.t_ns)
    assert np.abs(got.csi.value - sent.csi.value).max() < 1e-4 * np.abs(sent.csi.value).max()


@pytest.mark.parametrize(("poses", "csi"), [(0, 1), (1, 0), (0, 0), (wire.MAX_POSES, wire.MAX_CSI)])
def test_every_size_fits_one_ethernet_frame(poses: int, csi: int) -> None:
    data = wire.encode(datagram(poses=poses, csi=csi), KEY)
    assert len(data) <= 1472
    got = wire.decode(data, KEY)
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
            wire.decode(bytes(forged), KEY)


def test_a_signed_datagram_of_wrong_length_is_refused() -> None:
    body = wire.encode(datagram(), KEY)[:-16] + b"more"
    with pytest.raises(wire.WireError, match="expected"):
        wire.decode(body + hmac.digest(KEY, body, hashlib.sha256)[:16], KEY)


def test_another_version_is_named() -> None:
    data = bytearray(wire.encode(datagram(), KEY))
    data[4] = 9
    with pytest.raises(wire.WireError, match="version 9"):
        wire.decode(bytes(data), KEY)


def receiver() -> NeighbourReceiver:
    return NeighbourReceiver(1, {2: "beacon"}, {2: KEY}, ManualClock(5))


def test_replays_and_strangers_are_refused_and_counted() -> None:
    listening = receiver()
    first, second = wire.encode(datagram(0), KEY), wire.encode(datagram(1), KEY)
    assert listening.take(second)
    assert not listening.take(second)
    assert not listening.take(first)
    assert listening.neighbours[2].refused_old == 2
    assert not listening.take(wire.encode(datagram(3, sender=9), KEY))
    assert not listening.take(wire.encode(datagram(3, sender=1), KEY))
    assert not listening.take(wire.encode(datagram(3), b"x" * 32))
    assert not listening.take(b"noise")
    counters = listening.counters
    assert (counters.unknown_sender, counters.own, counters.bad_signature, counters.malformed) == (1, 1, 1, 1)
    assert listening.neighbours[2].accepted == 1


def test_a_reboot_starts_over() -> None:
    listening = receiver()
    assert listening.take(wire.encode(datagram(5, boot_id=1), KEY))
    assert listening.take(wire.encode(datagram(0, boot_id=2), KEY))
    assert len(listening.neighbours[2].poses()[0]) == 5  # nothing of the old clock is left


def test_a_beacon_stays_under_5_kilobytes_a_second() -> None:
    sender = NeighbourSender(wire.Role.BEACON, 2, KEY, pose_rate_hz=50)
    listening = receiver()
    total = 0
    for step in range(10_000):  # 10 s in ms
        t_ns = BASE_NS + step * 1_000_000
        if step % 5 == 0 and sender.wants_pose(t_ns):
            sender.add_pose(t_ns, (0.0, 0.0, 0.0), 3)
        if step * 150 // 1000 != (step + 1) * 150 // 1000:
            sender.add_channel(step, t_ns, step, 1 + 1j, 0)
        if step % 100 == 99 and (data := sender.datagram()) is not None:
            total += len(data) + 28  # with UDP and IP headers
            assert listening.take(data)
    assert total / 10 < 5000
    assert sender.dropped == 0
    assert len(listening.neighbours[2].channels_since(0).frame) == 1500
    assert len(listening.neighbours[2].poses()[0]) in range(490, 511)
