"""Radio, cameras, window, worker's computation and estimator as they are, beside the mock's commander: the world of
`companion.study.virtual_mission` under the same faults.

Of a scenario's faults those of what is drawn elsewhere do not apply: a worker that doubts or lies, a clock relation
that is lost by command; a suspended host stands still as a stopped process does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.random import SeedSequence

from companion.core.clock import NS_PER_S, Clock
from companion.core.messages import Pose, Vector3
from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from companion.radio.card import ChannelSample
from companion.roles.beacon import Beacon
from companion.sensing.iterations import SarIterations
from companion.sensing.window import SarWindow
from companion.sensing.worker_wire import AoaResult
from companion.sim.scenario import VioScenario
from companion.sim.trajectory import BeaconDrive, VehicleTrack
from companion.study.link import room, scenario
from companion.study.virtual_mission import with_levers
from companion.study.virtual_parts import BEACON_ID, UAV_ID, CameraFeed, InlineWorker, RadioFeed
from tests.faults.missions.port import Around, Started
from tests.faults.missions.scenario import Fault, Scenario
from wsr.channel import wavelength_m
from wsr.displacement import antenna_positions

ANTENNA_M: Final[Vector3] = (0.06, 0.03, -0.05)
_BEACON_ANTENNA_M: Final[Vector3] = (0.0, 0.0, 0.5)
LATER_S: Final = 6.0
"""Cameras and the clock relation want some past before anything is ready."""
_VIO_RATE_HZ: Final = 50.0
_LISTENS: Final = 3
"""Between legs nothing is measured: one step's packets of so many show that the target is there."""
_KEY: Final = bytes(wire.MIN_KEY_BYTES)


def real(drawn: Scenario) -> Scenario:
    """The same draw for a world that needs time to become ready."""
    config = replace(drawn.config, pose=replace(drawn.config.pose, antenna_m=ANTENNA_M))
    faults = tuple(_later(fault) for fault in drawn.faults if not _is_drawn_only(fault))
    return replace(drawn, config=config, faults=faults)


def _later(fault: Fault) -> Fault:
    word = "process" if fault.word == "suspend" else fault.word
    return replace(fault, at_s=fault.at_s + LATER_S, word=word)


def _is_drawn_only(fault: Fault) -> bool:
    return fault.kind == "clock" or fault.word in ("doubts", "lies")


class Reality:
    """The world of one mission: it goes on whatever becomes of the service."""

    def __init__(self, drawn: Scenario) -> None:
        seed = SeedSequence(drawn.seed)
        rng = np.random.default_rng(seed)
        target = np.array([drawn.target_enu_m[0], drawn.target_enu_m[1], 0.0])
        radio = room(rng, [np.zeros(3), target], occluded=bool(rng.random() < 0.3))
        world = replace(
            scenario(seed, radio),
            start_distance_m=float(np.linalg.norm(target)),
            beacon_azimuth_rad=math.atan2(target[1], target[0]),
            vio=VioScenario(rate_hz=_VIO_RATE_HZ),
            drive_speed_m_s=0.1 if rng.random() < 0.3 else 0.0,
        )
        self.scenario = with_levers(world)
        self.track, self.drive = VehicleTrack(), BeaconDrive(self.scenario)
        self.radio = RadioFeed(self.scenario)
        self.cameras = CameraFeed(self.scenario, 0), CameraFeed(self.scenario, 1)
        rate_hz = drawn.config.neighbours.pose_rate_hz
        self.sender = NeighbourSender(
            role=wire.Role.BEACON, own_id=BEACON_ID, key=_KEY, pose_rate_hz=rate_hz, boot_id=1
        )
        self.beacon = Beacon(self.sender)
        self.clock_ns = round(self.scenario.beacon.clock_offset_s * NS_PER_S)
        self.now_s = 0.0
        self._steps = 0

    def go_on(self, world: Around, service: Started | None) -> None:
        """Up to the clock's time. Without a `service` that hears it, what was sent is gone."""
        from_s, self.now_s = self.now_s, world.clock.t_ns / NS_PER_S
        airframe = world.vehicle.airframe
        if self.track.newest_s is None:
            self.track.append(from_s, airframe.p_enu_m, airframe.yaw_enu_rad)
        self.track.append(self.now_s, airframe.p_enu_m, airframe.yaw_enu_rad)
        uav = self.track.trajectory(from_s, self.now_s)
        beacon = self.drive.trajectory(from_s, self.now_s)
        self.drive.watch(self.now_s, float(np.linalg.norm(uav.p_enu_m[-1] - beacon.p_enu_m[-1])))
        poses = self.cameras[0].poses(self.now_s, uav)
        self._share(self.cameras[1].poses(self.now_s, beacon))
        self._steps += 1
        if service is None or not (service.sar.is_measuring or self._steps % _LISTENS == 0):
            self.radio.skip_to(self.now_s)
            heard: list[tuple[bool, ChannelSample]] = []
        else:
            heard = self.radio.samples(self.now_s, uav, beacon)
        for is_ours, sample in heard:
            if not is_ours:
                self.beacon.add_sample(sample)
        datagrams = self.sender.datagrams(world.clock.t_ns + self.clock_ns)
        if service is not None and isinstance(service.senses, RealSenses):
            world.give_poses(service, poses)
            service.senses.hear(world, service, [sample for is_ours, sample in heard if is_ours], datagrams)

    def _share(self, poses: list[Pose]) -> None:
        """The beacon's, as its service queues them for the next datagram."""
        if not poses:
            return
        p_m, q_wxyz = np.array([p.p_enu_m for p in poses]), np.array([p.q_enu_from_body for p in poses])
        for pose, antenna_m in zip(poses, antenna_positions(p_m, q_wxyz, _BEACON_ANTENNA_M), strict=True):
            if self.sender.wants_pose(pose.t_mono_ns):
                self.sender.add_pose(pose.t_mono_ns, antenna_m, pose.confidence)


class FaultyWorker(InlineWorker):
    """The worker's computation, whose answers a fault may keep or spoil."""

    def __init__(self, estimator: str, clock: Clock) -> None:
        super().__init__(estimator, clock)
        self.does = ""

    def give(self, sar: SarIterations, now_ns: int) -> None:
        if self.does in ("hangs", "gone"):
            return
        for result in self.due(now_ns):
            lost = AoaResult(id=result.id, peer=result.peer, compute_s=0.1, refusal="the worker was lost", failed=True)
            refused = AoaResult(id=result.id, peer=result.peer, compute_s=0.1, refusal="too few packets")
            sar.take_answer({"lost": lost, "refuses": refused}.get(self.does, result))


class RealSenses:
    """What one start of the service has between the radio and its bearings."""

    def __init__(self, world: Around) -> None:
        config, clock = world.scenario.config, world.clock
        self._clock = clock
        self.window = SarWindow(
            antenna_m=config.pose.antenna_m,
            wavelength_m=wavelength_m(config.csi.channel),
            min_packets=config.aperture.min_packets,
            max_pose_gap_s=config.aperture.max_pose_gap_s,
        )
        self.receiver = NeighbourReceiver(UAV_ID, {BEACON_ID: "beacon"}, {BEACON_ID: (_KEY,)}, clock)
        self.neighbours = self.receiver.neighbours
        self.worker = FaultyWorker(config.aperture.estimator, clock)
        self.on_pose: Callable[[Pose], None] = self.window.add_pose

    @property
    def is_related(self) -> bool:
        return not self.neighbours[BEACON_ID].not_locked(self._clock.t_ns)

    def apply(self, world: Around) -> None:
        self.worker.does = world.word("worker")

    def turn(self, world: Around, service: Started) -> None:
        """All of it came from `Reality.go_on`; here are the answers that are due."""
        self.worker.give(service.sar, world.clock.t_ns)

    def hear(self, world: Around, service: Started, samples: list[ChannelSample], datagrams: list[bytes]) -> None:
        if not world.lasts("packets"):
            for sample in samples:
                self.window.add_sample(sample)
                self.neighbours[BEACON_ID].add_forward(sample.frame, sample.t_mono_ns, sample.nic_us)
                service.flight.knowledge.heard(sample)
                world.note_packet()
        if not world.lasts("datagrams"):
            for datagram in datagrams:
                self.receiver.take(datagram)
                world.note_datagram()
