"""Bearings in a datagram: what goes in comes out, what nothing measures is refused, and two of them take 40 bytes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.neighbours import wire
from companion.neighbours.sender import NeighbourSender
from companion.neighbours.sightings import MAX_SIGHTINGS, Sighting, packed_sightings, unpacked_sightings
from tests.datagrams import BASE_NS, KEY, KEYS, boot, datagram, receiver

SEEN = Sighting(
    target=1,
    number=5,
    t_ns=BASE_NS - 1_500_000_000,
    azimuth_rad=3.1,
    azimuth_std_rad=0.03,
    polar_rad=1.4,
    polar_std_rad=0.1,
    range_m=None,
    range_std_m=math.inf,
    reliability=0.7,
    fresh=0.2,
)


def test_a_bearing_comes_out_as_it_went_in() -> None:
    sent_ns = datagram().sent_ns
    got, used = unpacked_sightings(packed_sightings([SEEN, replace(SEEN, azimuth_rad=-math.pi)], sent_ns), sent_ns)
    assert used == 1 + 2 * 20
    assert got[0].azimuth_rad == pytest.approx(SEEN.azimuth_rad, abs=5e-5)
    assert math.cos(got[1].azimuth_rad) == pytest.approx(-1.0)
    assert (got[0].target, got[0].number, got[0].t_ns, got[0].range_m) == (1, 5, SEEN.t_ns, None)
    assert got[0].reliability == pytest.approx(0.7, abs=2e-3)
    assert got[0].fresh == pytest.approx(0.2, abs=2e-3)
    assert math.isinf(got[0].range_std_m)


def test_a_datagram_with_all_it_can_hold_fits_one_ethernet_frame() -> None:
    full = datagram(poses=wire.MAX_POSES, csi=wire.MAX_CSI)
    full = replace(full, sightings=(replace(SEEN, t_ns=full.sent_ns - 1),) * MAX_SIGHTINGS)
    assert len(wire.encode(full, KEY)) <= 1472


@pytest.mark.parametrize("cut", range(1, 60, 7))
def test_a_signed_datagram_whose_bearings_are_not_whole_is_refused(cut: int) -> None:
    sent = replace(datagram(poses=0, csi=0), sightings=(SEEN, SEEN, SEEN))
    body = wire.encode(sent, KEY)[: -wire.TAG_BYTES]
    with pytest.raises(wire.WireError):
        wire.decode(wire.signed(body[:-cut], KEY), KEYS)


@pytest.mark.parametrize("at", [8, 10, 12, 14])
def test_what_nothing_measures_is_refused(at: int) -> None:
    """No deviation, a polar angle beyond the pole, no range at all."""
    data = bytearray(packed_sightings([SEEN], BASE_NS))
    data[1 + at : 3 + at] = b"\xff\xff" if at == 10 else b"\0\0"
    with pytest.raises(ValueError, match="nothing measures"):
        unpacked_sightings(bytes(data), BASE_NS)


def test_too_many_and_too_old_are_the_callers_mistake() -> None:
    with pytest.raises(ValueError, match="at most 8"):
        packed_sightings([SEEN] * 9, BASE_NS)
    with pytest.raises(ValueError, match="65 s"):
        packed_sightings([SEEN], BASE_NS + 70_000_000_000)


def test_each_bearing_is_sent_twice_and_old_ones_not_at_all() -> None:
    sender, listening = _sender(), receiver()
    sender.add_sighting(SEEN)
    sender.add_sighting(replace(SEEN, number=6, t_ns=BASE_NS - 40_000_000_000))
    made = [data for step in range(4) for data in sender.datagrams(BASE_NS + step * 100_000_000)]
    assert all(map(listening.take, made))
    received = listening.neighbours[2].received
    assert [one.number for _, got in received for one in got.sightings] == [5, 5]
    assert len(made) == 2


def test_five_robots_bearings_at_the_busiest_stay_in_the_budget() -> None:
    """Four others, each looked at twice a second, beside 150 channels and 50 poses a second."""
    sender, listening = _sender(), receiver()
    rng = np.random.default_rng(1)
    heard = 0
    for step in range(10_000):
        t_ns = BASE_NS + step * 1_000_000
        if step % 20 == 0:
            sender.add_pose(t_ns, rng.normal(0, 0.05, 3), 3)
        if step % 20 in (3, 9, 15):
            csi = (rng.normal(size=30) + 1j * rng.normal(size=30)).astype(np.complex64) * 20
            sender.add_channel(step, t_ns, step * 1000, csi, power_dbm=-55.0, antenna=0)
        if step % 500 == 0:
            for target in (1, 3, 4, 5):
                sender.add_sighting(replace(SEEN, target=target, number=step // 500, t_ns=t_ns - 1_500_000_000))
        if step % 100 == 99:
            heard += sum(map(listening.take, sender.datagrams(t_ns)))
    assert sender.sent_bytes / 10 < 5000
    assert (sender.thinned, sender.dropped) == (0, 0)
    said = {(s.target, s.number) for _, got in listening.neighbours[2].received for s in got.sightings}
    assert len(said) == 80 and heard == 100


def _sender() -> NeighbourSender:
    return NeighbourSender(role=wire.Role.UAV, own_id=2, key=KEY, pose_rate_hz=50, boot_id=boot(1))
