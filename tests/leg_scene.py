"""One leg of a drone and a beacon that drives, as the drone's service sees them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose
from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from companion.radio.card import ChannelSample, Radio
from companion.replay.recorded import RecordedCsi
from companion.roles.beacon import Beacon
from companion.sensing.window import ApertureReport, SarWindow
from companion.sim.radio import simulate_exchanges
from companion.sim.scenario import RadioScenario
from companion.sim.trajectory import Trajectory
from csi_bridge.encoder import encode_body
from csi_bridge.records import CSI_CODE, CsiRecord
from tests.manual_clock import ManualClock
from tests.sim_scenes import BEACON_MAC, UAV_MAC, scene, straight, weave
from wsr.channel import wavelength_m
from wsr.estimators.robust import Robust
from wsr.geometry import direction, great_circle

KEY = b"k" * 32
LEVER_M = (0.02, 0.05, 0.1)
BEACON_LEVER_M = (0.02, 0.05, 0.5)
OTHER_CLOCK_NS = 5_000 * NS_PER_S
"""The beacon's monotonic clock differs from ours by this: nothing may depend on it."""


def mac(text: str) -> bytes:
    return bytes.fromhex(text.replace(":", ""))


def play(records: Iterable[CsiRecord], peers: dict[bytes, int], base_ns: int) -> list[ChannelSample]:
    """The samples of one card whose host reads each record 0.2 ms after the packet."""
    clock, tape = ManualClock(), RecordedCsi()
    samples: list[ChannelSample] = []
    radio = Radio(source=tape, peers=peers, clock=clock, on_sample=samples.append, on_record=lambda *_: None)
    wall_ns: int | None = None
    for record in records:
        assert record.host_time_ns is not None
        wall_ns = record.host_time_ns if wall_ns is None else wall_ns
        clock.advance((base_ns + record.host_time_ns - wall_ns + 200_000 - clock.now_ns()) / NS_PER_S)
        tape.add([(CSI_CODE, encode_body(record))])
        radio.drain()
    return samples


def poses_of(trajectory: Trajectory, shift_ns: int, yaw_of_frame_rad: float = 0.0) -> list[Pose]:
    """Exact poses at 200 Hz in a frame with another origin."""
    t_s = np.arange(trajectory.t_s[0], trajectory.t_s[-1], 0.005)
    p_m, yaw = trajectory.at(t_s)
    return [
        Pose(
            t_mono_ns=round(t * NS_PER_S) + shift_ns,
            p_enu_m=(x - 7.0, y + 3.0, z),
            q_enu_from_body=(math.cos(a / 2), 0.0, 0.0, math.sin(a / 2)),
            v_enu_m_s=(0, 0, 0),
            confidence=3,
        )
        for t, (x, y, z), a in zip(t_s.tolist(), p_m.tolist(), yaw.tolist(), strict=True)
    ]


class Scene:
    """One leg of the drone and a beacon that drives, as the service of the drone would see it."""

    def __init__(self, azimuth_rad: float, seed: int = 3, radio: RadioScenario | None = None) -> None:
        self.scenario = scene(seed=seed, radio=radio)
        self.uav = weave(azimuth_rad + 0.6)
        # Far away: the far-field estimate is biased by the curvature of the wave where two metres of aperture are not
        # small against the range.
        start = 40 * np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
        self.beacon = straight(start, np.array([0.3, -0.2, 0.0]), 1.0, 3.0, yaw_rad=0.4)
        at_uav, at_beacon = simulate_exchanges(self.scenario, self.uav, self.beacon)
        self.first_ns = round(1.0 * NS_PER_S)
        self.forward = play(at_uav, {mac(BEACON_MAC): 2}, self.first_ns)
        self.reverse = play(at_beacon, {mac(UAV_MAC): 1}, OTHER_CLOCK_NS)
        self.datagrams = self._broadcast()

    def _broadcast(self) -> list[bytes]:
        sender = NeighbourSender(role=wire.Role.BEACON, own_id=2, key=KEY, pose_rate_hz=50, boot_id=1 << 32)
        beacon = Beacon(sender)
        poses = iter(poses_of(self.beacon, OTHER_CLOCK_NS - self.first_ns))
        datagrams = []
        for number, sample in enumerate(self.reverse, 1):
            beacon.add_sample(sample)
            if number % 15 == 0:
                for _ in range(20):
                    if (pose := next(poses, None)) is not None and sender.wants_pose(pose.t_mono_ns):
                        sender.add_pose(pose.t_mono_ns, pose.p_enu_m, pose.confidence)
                datagrams += sender.datagrams(sample.t_mono_ns + 1)
        return datagrams

    def window(self) -> SarWindow:
        window = SarWindow(antenna_m=LEVER_M, wavelength_m=wavelength_m(108), min_packets=80, max_pose_gap_s=0.05)
        for pose in poses_of(self.uav, 0):
            window.add_pose(pose)
        for sample in self.forward:
            window.add_sample(sample)
        return window

    def receiver(self, datagrams: Iterable[bytes]) -> NeighbourReceiver:
        receiver = NeighbourReceiver(1, {2: "beacon"}, {2: (KEY,)}, ManualClock(self.first_ns))
        for datagram in datagrams:
            receiver.take(datagram)
        return receiver

    def cut(self, window: SarWindow | None = None, datagrams: list[bytes] | None = None) -> ApertureReport:
        neighbour = self.receiver(self.datagrams if datagrams is None else datagrams).neighbours[2]
        return (window or self.window()).cut(neighbour, self.first_ns, self.first_ns + 3 * NS_PER_S)

    def error_deg(self, report: ApertureReport) -> float:
        assert report.aperture is not None, report.refusal
        estimate, _ = Robust().estimate(report.aperture)
        t_s = 1.0 + estimate.reference_t_s
        uav = self.uav.antennas_at(np.array([t_s]), np.array([LEVER_M]))[0, 0]
        beacon = self.beacon.antennas_at(np.array([t_s]), np.array([BEACON_LEVER_M]))[0, 0]
        found = direction(estimate.azimuth_rad, estimate.polar_rad)
        return math.degrees(float(great_circle(found, (beacon - uav) / np.linalg.norm(beacon - uav))))
