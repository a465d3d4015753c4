"""Bytes of both cards and pose datagrams in, an aperture with the right bearing out: the service's own chain."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.radio.card import ChannelSample, Radio
from companion.replay.recorded import RecordedCsi
from companion.sensing.window import SarWindow
from companion.sensing.worker_wire import aperture_of, request_of
from csi_bridge.encoder import encode_body
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.records import CSI_CODE
from tests import ax_leg, csi_records, feit_records
from tests.leg_scene import BEACON_LEVER_M, KEY, LEVER_M, Scene, poses_of
from tests.manual_clock import ManualClock
from wsr.channel import wavelength_m
from wsr.estimators.robust import Robust
from wsr.geometry import direction, great_circle


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
    empty = SarWindow(antenna_m=LEVER_M, wavelength_m=wavelength_m(108), min_packets=80, max_pose_gap_s=0.05)
    assert "no packets of beacon" in scene.cut(window=empty).refusal
    assert "has its reverse channel" in scene.cut(datagrams=[]).refusal
    for sample in scene.forward:
        empty.add_sample(sample)
    report = scene.cut(window=empty)
    assert report.aperture is None
    assert report.dropped["no own pose"] > 200


def test_a_pose_gap_drops_its_packets() -> None:
    scene = Scene(math.radians(45))
    window = SarWindow(antenna_m=LEVER_M, wavelength_m=wavelength_m(108), min_packets=80, max_pose_gap_s=0.05)
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
    Radio(
        source=tape, peers=peers, clock=ManualClock(10**9), on_sample=samples.append, on_record=lambda *_: None
    ).drain()
    window = SarWindow(antenna_m=(0.0, 0.0, 0.0), wavelength_m=0.054, min_packets=20, max_pose_gap_s=0.05)
    for sample in samples:
        window.add_sample(sample)
        window.add_sample(sample._replace(peer=4))
    assert [sample.peer for sample in samples] == [2, 3, 2, 3]


@pytest.mark.parametrize("width_mhz", [pytest.param(20, marks=pytest.mark.long), 80])
def test_the_bearing_of_a_leg_with_ax_cards(width_mhz: Literal[20, 80]) -> None:
    window, neighbour, sent = ax_leg.flown(width_mhz)
    assert {data[4] for data in sent} <= {wire.VERSION, wire.WIDE_VERSION}
    assert max(map(len, sent)) <= 1400
    report = window.cut(neighbour, ax_leg.FIRST_NS, ax_leg.FIRST_NS + 3 * NS_PER_S)
    assert report.aperture is not None, report.refusal
    assert report.aperture.packets > 0.75 * report.received
    aperture = aperture_of(request_of(1, 2, report.aperture))
    assert aperture.half_turns and aperture.grid.size == {20: 30, 80: 124}[width_mhz]
    estimate = Robust().estimate(aperture)[0]
    t_s = np.array([1.0 + estimate.reference_t_s])
    away = ax_leg.BEACON.antennas_at(t_s, np.array([BEACON_LEVER_M])) - ax_leg.UAV.antennas_at(t_s, np.array([LEVER_M]))
    found = direction(estimate.azimuth_rad, estimate.polar_rad)
    assert math.degrees(float(great_circle(found, away[0, 0] / np.linalg.norm(away[0, 0])))) < 3.0


def test_channels_of_another_band_are_refused_by_name() -> None:
    window, _, _ = ax_leg.flown(80)
    _, neighbour, _ = ax_leg.flown(20)
    report = window.cut(neighbour, ax_leg.FIRST_NS, ax_leg.FIRST_NS + 3 * NS_PER_S)
    assert "heard over HE 80 MHz and sends channels of HE 20 MHz" in report.refusal
