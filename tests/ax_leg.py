"""One leg of a drone with an AX card and of the robot it hears, as the drone's service sees them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.neighbour import Neighbour
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from companion.radio.card import ChannelSample, Radio
from companion.replay.recorded import RecordedCsi
from companion.roles.beacon import Beacon
from companion.sensing.window import SarWindow
from companion.sim.ax_radio import simulate_ax_exchanges
from companion.sim.radio import DEFAULT_EPOCH_NS
from companion.sim.scenario import RadioScenario, ax210_radio
from companion.sim.trajectory import Trajectory
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import FEITCSI_CODE, FeitRecord
from tests.leg_scene import KEY, LEVER_M, mac, poses_of
from tests.manual_clock import ManualClock
from tests.sim_scenes import BEACON_MAC, UAV_MAC, scene, straight, weave
from wsr.channel import wavelength_m
from wsr.geometry import direction

AZIMUTH_RAD = math.radians(40.0)
FIRST_NS = NS_PER_S
THEIRS_NS = 7_000 * NS_PER_S
UAV = weave(AZIMUTH_RAD + 0.6)
BEACON = straight(40 * direction(AZIMUTH_RAD, math.pi / 2), np.array([0.3, -0.2, 0.0]), 1.0, 3.0, yaw_rad=0.4)


def heard(records: Iterable[FeitRecord], sender: str, shift_ns: int) -> list[ChannelSample]:
    """Of a host that reads each record 0.2 ms after the packet."""
    clock, tape, samples = ManualClock(), RecordedCsi(), list[ChannelSample]()
    radio = Radio(source=tape, peers={mac(sender): 2}, clock=clock, on_sample=samples.append, on_record=lambda *_: None)
    for record in records:
        t_ns = record.host_time_us * 1000 - DEFAULT_EPOCH_NS + shift_ns + 200_000
        clock.advance((t_ns - clock.now_ns()) / NS_PER_S)
        tape.add([(FEITCSI_CODE, encode_record(record))])
        radio.drain()
    return samples


def flown(
    width_mhz: Literal[20, 80], uav: Trajectory = UAV, beacon: Trajectory = BEACON
) -> tuple[SarWindow, Neighbour, list[bytes]]:
    """What the drone's window and its neighbour hold after a leg, and the datagrams of the beacon."""
    radio = ax210_radio(RadioScenario(), width_mhz)
    world = scene(3, radio, beacon_clock_offset_s=0.0)
    at_uav, at_beacon = simulate_ax_exchanges(world, uav, beacon, host_stamps=True)
    forward, reverse = heard(at_uav, BEACON_MAC, 0), heard(at_beacon, UAV_MAC, THEIRS_NS)
    window = SarWindow(antenna_m=LEVER_M, wavelength_m=wavelength_m(108), min_packets=80, max_pose_gap_s=0.05)
    for own in poses_of(uav, 0):
        window.add_pose(own)
    for sample in forward:
        window.add_sample(sample)
    clock = ManualClock(FIRST_NS)
    receiver = NeighbourReceiver(1, {2: "beacon"}, {2: (KEY,)}, clock)
    sender = NeighbourSender(
        role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=1 << 32, budget_bytes_s=10_000
    )
    role, poses, sent = Beacon(sender), iter(poses_of(beacon, THEIRS_NS)), list[bytes]()
    for number, sample in enumerate(reverse, 1):
        role.add_sample(sample)
        if number % 15 == 0:
            for _ in range(20):
                if (pose := next(poses, None)) is not None and sender.wants_pose(pose.t_mono_ns):
                    sender.add_pose(pose.t_mono_ns, pose.p_enu_m, pose.confidence)
            for data in sender.datagrams(sample.t_mono_ns + 1):
                clock.advance((sample.t_mono_ns - THEIRS_NS + 2_000_000 - clock.now_ns()) / NS_PER_S)
                receiver.take(data)
                sent.append(data)
    return window, receiver.neighbours[2], sent
