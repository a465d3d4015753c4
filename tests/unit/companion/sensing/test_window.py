"""Bytes of both cards and pose datagrams in, an aperture with the right bearing out: the service's own chain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.radio.card import ChannelSample, Radio
from companion.replay.recorded import RecordedCsi
from companion.sensing.window import SarWindow
from csi_bridge.encoder import encode_body
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.records import CSI_CODE
from tests import csi_records, feit_records
from tests.leg_scene import KEY, LEVER_M, Scene, poses_of
from tests.manual_clock import ManualClock
from wsr.channel import wavelength_m


@pytest.mark.parametrize("azimuth_deg", [10, 100, -130])
def test_the_bearing_is_right_with_both_ends_moving_and_clocks_apart(azimuth_deg: float) -> None:
    scene = Scene(math.radians(azimuth_deg))
    report = scene.cut()
    assert report.aperture is not None
    assert report.aperture.packets > 0.8 * report.received
    assert scene.error_deg(report) < 3.0


def test_ignoring_the_neighbours_motion_would_be_seen() -> None:
    """The drive of the beacon matters here: without it this file would not notice a forgotten p_j."""
    scene = Scene(math.radians(10))
    still = replace(scene.cut())
    frozen = [
        wire.encode(
            replace(datagram, poses=replace(datagram.poses, p_enu_m=np.zeros_like(datagram.poses.p_enu_m))), KEY
        )
        for datagram in (wire.decode(data, (KEY,)) for data in scene.datagrams)
    ]
    assert scene.error_deg(scene.cut(datagrams=frozen)) > 5 + scene.error_deg(still)


def test_lost_datagrams_cost_packets_not_the_bearing() -> None:
    scene = Scene(math.radians(45))
    some = [datagram for number, datagram in enumerate(scene.datagrams) if number % 4]
    report = scene.cut(datagrams=some)
    assert report.dropped["unpaired"] > 50
    assert scene.error_deg(report) < 3.0


def test_refusals_say_what_is_missing() -> None:
    scene = Scene(math.radians(45))
    empty = SarWindow(LEVER_M, wavelength_m(108), 80, 0.05)
    assert "no packets of beacon" in scene.cut(window=empty).refusal
    assert "has its reverse channel" in scene.cut(datagrams=[]).refusal
    for sample in scene.forward:
        empty.add_sample(sample)
    report = scene.cut(window=empty)
    assert report.aperture is None
    assert report.dropped["no own pose"] > 200


def test_a_pose_gap_drops_its_packets() -> None:
    scene = Scene(math.radians(45))
    window = SarWindow(LEVER_M, wavelength_m(108), 80, 0.05)
    for pose in poses_of(scene.uav, 0):
        if not 1.5 < pose.t_mono_ns / NS_PER_S < 1.8:
            window.add_pose(pose)
    for sample in scene.forward:
        window.add_sample(sample)
    assert 35 < scene.cut(window=window).dropped["no own pose"] < 50


def test_the_window_keeps_samples_of_both_cards() -> None:
    tape, samples = RecordedCsi(), list[ChannelSample]()
    for _ in range(2):
        tape.add([(FEITCSI_CODE, encode_record(feit_records.record())), (CSI_CODE, encode_body(csi_records.record()))])
    peers = {feit_records.MAC: 2, csi_records.MAC: 3}
    Radio(tape, peers, ManualClock(10**9), samples.append, lambda *_: None).drain()
    window = SarWindow((0.0, 0.0, 0.0), 0.054, 20, 0.05)
    for sample in samples:
        window.add_sample(sample)
        window.add_sample(replace(sample, peer=4))
    assert [sample.peer for sample in samples] == [2, 3, 2, 3]
