"""One mission at virtual time: the service's own flight, mission, gate, guidance, window, worker and tracker code over
a kinematic vehicle, drifting cameras and the simulated radio.

What is left out of the service: sockets and pipes, parsing of records, the map from card time to host time, the
recorder, take-off and the autopilot (the vehicle starts in a hover and grants every mode at once).
"""

from __future__ import annotations

import asyncio
import logging
import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from numpy.random import SeedSequence

from companion import wire
from companion.aoa_process import AoaProcess
from companion.aoa_wire import AoaResult, request_of
from companion.aoa_worker import compute
from companion.beacon import Beacon
from companion.clock import NS_PER_S
from companion.config import AutopilotConfig, Config, CsiConfig, MissionConfig, NeighbourConfig, Peer, PoseConfig
from companion.flight import Flight
from companion.messages import FlightMode, Pose, Setpoint, Vector3, VehicleState
from companion.mission import Event, State
from companion.neighbours import NeighbourReceiver, NeighbourSender
from companion.node import Node
from companion.pose.source import BodyFrame
from companion.radio import ANTENNAS, ChannelSample
from companion.recorder import Recorder
from companion.sar import Iteration, SarIterations
from companion.sim.px4_airframe import Airframe, AirframeLimits, Demand, Gusts
from companion.sim.radio import DEFAULT_EPOCH_NS, RadioLink
from companion.sim.scenario import Scenario
from companion.sim.trajectory import BeaconDrive, Trajectory, VehicleTrack
from companion.sim.vio import Camera
from companion.study.virtual_clock import VirtualClock
from companion.window import SarWindow
from csi_bridge.records import CsiRecord
from wsr.channel import centre_channel, wavelength_m
from wsr.displacement import antenna_positions
from wsr.estimators import ESTIMATORS

Array = npt.NDArray[np.float64]

RENDEZVOUS_M = 2.0
_UAV, _BEACON = 1, 2
_KEY = bytes(wire.MIN_KEY_BYTES)
_START_NS = 5 * NS_PER_S  # apertures and cameras want some past
_AIRFRAME_S = 0.025
_BATCH_S = 0.1
_COMPUTE_S = 0.1  # that the worker needs on the vehicle's processor, of which the flight waits for
_LEVER_M: Vector3 = (0.06, 0.03, -0.05)
_BEACON_LEVER_M: Vector3 = (0.0, 0.0, 0.5)
_OVER = frozenset({State.IDLE, State.LATCHED, State.FAULT, State.LANDING, State.ARRIVED})

logging.getLogger("companion.flight").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class MissionPoint:
    """One SAR iteration with the truth at its reference point and time; positions of the antennas."""

    iteration: Iteration
    uav_enu_m: Vector3
    beacon_enu_m: Vector3
    is_beacon_moving: bool


@dataclass(frozen=True, slots=True)
class MissionResult:
    reached: bool
    """The antennas came within 2 m."""
    time_s: float
    """From engaging to that, or to the end."""
    closest_m: float
    end: str
    points: list[MissionPoint]


def config() -> Config:
    """The defaults of a vehicle, on channel 108; its files and sockets are never opened."""
    return Config(
        role="uav",
        id=_UAV,
        name="uav",
        csi=CsiConfig(channel=108, source="unix"),
        neighbours=NeighbourConfig(key_file="none"),
        peers=[Peer(_BEACON, "beacon", "00:21:6A:00:00:02", "none")],
        pose=PoseConfig(antenna_m=_LEVER_M),
        mission=MissionConfig(),
        autopilot=AutopilotConfig("none"),
    )


def with_levers(scenario: Scenario) -> Scenario:
    """The scenario with the antennas of both robots off their cameras, as on the vehicles."""
    uav, beacon = (
        replace(robot, antennas_m=((x, y, z), (x, y + 0.06, z), (x, y - 0.06, z)))
        for robot, (x, y, z) in ((scenario.uav, _LEVER_M), (scenario.beacon, _BEACON_LEVER_M))
    )
    return replace(scenario, uav=uav, beacon=beacon)


def fly(scenario: Scenario, seed: SeedSequence, max_time_s: float) -> MissionResult:
    """The same arguments give the same mission."""
    return asyncio.run(_fly(scenario, seed, max_time_s))


async def _fly(scenario: Scenario, seed: SeedSequence, max_time_s: float) -> MissionResult:
    clock = VirtualClock()
    world = _World(with_levers(scenario), int(seed.generate_state(2)[1]), clock, max_time_s)
    flying = asyncio.create_task(world.flight.run())
    await clock.run(world.live)
    flying.cancel()
    await asyncio.gather(flying, return_exceptions=True)
    if not flying.cancelled() and (error := flying.exception()) is not None:
        raise error
    return world.result()


class _Vehicle:
    """An airframe that grants every mode at once; a `companion.autopilot.port.Autopilot`."""

    def __init__(self, seed: int, height_m: float, clock: VirtualClock) -> None:
        self._clock = clock
        self._setpoint: Setpoint | None = None
        self._mode = FlightMode.HOLD
        self._hover_m: Vector3 = (0.0, 0.0, height_m)
        self.airframe = Airframe(AirframeLimits(), 0.0, Gusts(seed))
        self.airframe.p_enu_m = self._hover_m

    def step(self) -> None:
        if self._mode is FlightMode.OFFBOARD and self._setpoint is not None:
            s = self._setpoint
            self.airframe.step(Demand(s.p_local_enu_m, s.v_local_enu_m_s, s.yaw_enu_rad), _AIRFRAME_S)
        else:
            self.airframe.step(Demand(self._hover_m, (0.0, 0.0, 0.0)), _AIRFRAME_S)

    async def connect(self, timeout_s: float = 10.0) -> None: ...

    async def aclose(self) -> None: ...

    def state(self) -> VehicleState:
        now_ns = self._clock.now_ns()
        return VehicleState(
            now_ns, now_ns, self._mode, now_ns, True, True, False, now_ns,
            self.airframe.estimated_p_enu_m, self.airframe.v_enu_m_s, self.airframe.yaw_enu_rad,
        )  # fmt: skip

    def send_setpoint(self, setpoint: Setpoint) -> None:
        self._setpoint = setpoint

    async def arm(self) -> None: ...

    async def takeoff(self, height_m: float) -> None: ...

    async def request_offboard(self) -> None:
        self._mode = FlightMode.OFFBOARD

    async def hold(self) -> None:
        self._hover_m, self._mode = self.airframe.p_enu_m, FlightMode.HOLD

    async def land(self) -> None:
        self._hover_m, self._mode = self.airframe.p_enu_m, FlightMode.LAND

    async def parameter(self, name: str) -> int | float:
        raise NotImplementedError(name)


class _Worker:
    """The AOA worker's computation in this process; results are taken when their time has come."""

    def __init__(self, estimator: str, clock: VirtualClock) -> None:
        self._estimator = ESTIMATORS[estimator]()
        self._clock = clock
        self._results: list[tuple[int, AoaResult]] = []
        self._next_id = 0
        self.ready = asyncio.Event()
        self.ready.set()

    def submit(self, peer: int, aperture: Any) -> int:
        request_id, self._next_id = self._next_id, self._next_id + 1
        result = compute(self._estimator, request_of(request_id, peer, aperture))
        self._results.append((self._clock.now_ns() + round(_COMPUTE_S * NS_PER_S), result))
        return request_id

    def due(self, now_ns: int) -> list[AoaResult]:
        done = [result for at_ns, result in self._results if at_ns <= now_ns]
        self._results = [(at_ns, result) for at_ns, result in self._results if at_ns > now_ns]
        return done


class _World:
    """Everything around the flight. Physics goes on in small steps, radio and cameras in batches."""

    def __init__(self, scenario: Scenario, gust_seed: int, clock: VirtualClock, max_time_s: float) -> None:
        settings = config()
        self._clock = clock
        self._end_ns = _START_NS + round(max_time_s * NS_PER_S)
        self._vehicle = _Vehicle(gust_seed, settings.mission.takeoff_height_m, clock)
        self._track, self._drive = VehicleTrack(), BeaconDrive(scenario)
        self._radio = _Radio(scenario)
        self._window = SarWindow(
            settings.pose.antenna_m,
            wavelength_m(settings.csi.channel),
            settings.aperture.min_packets,
            settings.aperture.max_pose_gap_s,
        )
        receiver = NeighbourReceiver(_UAV, {_BEACON: "beacon"}, {_BEACON: _KEY}, clock)
        self._receiver = receiver
        self._sender = NeighbourSender(wire.Role.BEACON, _BEACON, _KEY, settings.neighbours.pose_rate_hz)
        self._beacon = Beacon(self._sender)
        self._cameras = (_CameraFeed(scenario, 0), _CameraFeed(scenario, 1))
        self._worker = _Worker(settings.aperture.estimator, clock)
        self._sar = SarIterations(
            self._window,
            cast(AoaProcess, self._worker),
            receiver.neighbours,
            settings.aperture,
            clock,
            self._on_iteration,
        )
        node = cast(Node, SimpleNamespace(receiver=receiver, pose_age_s=lambda: 0.0))
        recorder = cast(Recorder, SimpleNamespace(record=lambda *_: None))
        self.flight = Flight(settings, clock, node, self._vehicle, self._sar, recorder)
        self._engaged = False
        self._batch_s = self._step_s = 0.0
        self._truth: list[tuple[float, Vector3, Vector3]] = []
        self._points: list[MissionPoint] = []
        self._moving_from_s = math.inf
        self._iterations: list[Iteration] = []

    def live(self, now_ns: int) -> bool:
        """Lives on until `now_ns`; False when the mission is over."""
        now_s = now_ns / NS_PER_S
        while self._step_s + _AIRFRAME_S <= now_s:
            self._step_s += _AIRFRAME_S
            if self._step_s * NS_PER_S > _START_NS:
                self._vehicle.step()
            self._track.append(self._step_s, self._vehicle.airframe.p_enu_m, self._vehicle.airframe.yaw_enu_rad)
        if now_s - self._batch_s >= _BATCH_S and self._step_s > self._batch_s:
            self._deliver(self._batch_s, self._step_s)
            self._batch_s = self._step_s
        for result in self._worker.due(now_ns):
            self._sar.take(result)
        if not self._engaged and now_ns >= _START_NS:
            self._engaged = not self.flight.wish(Event.ENGAGE)
        return not self._is_over(now_ns)

    def result(self) -> MissionResult:
        apart = [math.dist(uav, beacon) for _, uav, beacon in self._truth]
        reached = bool(apart) and apart[-1] <= RENDEZVOUS_M
        time_s = max(0.0, self._clock.now_ns() - _START_NS) / NS_PER_S
        end = "rendezvous" if reached else str(self.flight.state)
        self._points = [self._point(iteration) for iteration in self._iterations]
        return MissionResult(reached, time_s, min(apart, default=math.inf), end, self._points)

    def _is_over(self, now_ns: int) -> bool:
        if now_ns >= self._end_ns:
            return True
        if self._truth and math.dist(*self._truth[-1][1:]) <= RENDEZVOUS_M:
            return True
        return now_ns > _START_NS + 2 * NS_PER_S and self.flight.state in _OVER

    def _deliver(self, from_s: float, until_s: float) -> None:
        """Poses, packets and datagrams of one batch."""
        uav = self._track.trajectory(from_s - _BATCH_S, until_s)
        beacon = self._drive.trajectory(max(0.0, from_s - _BATCH_S), until_s)
        self._note_truth(until_s, uav, beacon)
        for pose in self._cameras[0].poses(until_s, uav):
            self._window.add_pose(pose)
        self._share_poses(self._cameras[1].poses(until_s, beacon))
        # Between legs nothing is measured: one batch now and then shows that the target is there.
        idle = self._sar.start_ns is None and int(until_s / _BATCH_S) % 5
        if idle:
            self._radio.skip_to(until_s)
        else:
            for peer_is_beacon, sample in self._radio.samples(until_s, uav, beacon):
                if peer_is_beacon:
                    self._window.add_sample(sample)
                    self.flight.heard(sample.peer, sample.t_mono_ns)
                else:
                    self._beacon.add_sample(sample)
        if (datagram := self._sender.datagram()) is not None:
            self._receiver.take(datagram)

    def _share_poses(self, poses: list[Pose]) -> None:
        """The beacon's, as its service queues them for the next datagram."""
        if not poses:
            return
        p_m, q_wxyz = np.array([p.p_enu_m for p in poses]), np.array([p.q_enu_from_body for p in poses])
        for pose, antenna_m in zip(poses, antenna_positions(p_m, q_wxyz, _BEACON_LEVER_M), strict=True):
            if self._sender.wants_pose(pose.t_mono_ns):
                self._sender.add_pose(pose.t_mono_ns, antenna_m, pose.confidence)

    def _note_truth(self, t_s: float, uav: Trajectory, beacon: Trajectory) -> None:
        at = np.array([t_s])
        u, b = (
            tuple(robot.antennas_at(at, np.array([lever]))[0, 0].tolist())
            for robot, lever in ((uav, _LEVER_M), (beacon, _BEACON_LEVER_M))
        )
        self._truth.append((t_s, u, b))
        self._drive.watch(t_s, math.dist(u, b))
        if math.isinf(self._moving_from_s) and any(self._drive.velocity(t_s)):
            self._moving_from_s = t_s

    def _on_iteration(self, iteration: Iteration, profile: bytes) -> None:
        self._iterations.append(iteration)
        self.flight.take(iteration, profile)

    def _point(self, iteration: Iteration) -> MissionPoint:
        t_s = iteration.reference_ns / NS_PER_S
        times = [t for t, _, _ in self._truth]
        ends = [np.array([row[i] for row in self._truth]) for i in (1, 2)]
        uav, beacon = (tuple(float(np.interp(t_s, times, p[:, axis])) for axis in range(3)) for p in ends)
        return MissionPoint(iteration, cast(Vector3, uav), cast(Vector3, beacon), t_s >= self._moving_from_s)


class _CameraFeed:
    """A camera with the times of its frames; poses come out in ENU, as the service's pose source gives them."""

    def __init__(self, scenario: Scenario, index: int) -> None:
        robot = (scenario.uav, scenario.beacon)[index]
        self._camera = Camera(scenario.vio, scenario.seed, index, robot.frame_yaw_rad)
        self._body = BodyFrame(robot.frame_yaw_rad)
        self._period_s = 1 / scenario.vio.rate_hz
        # The other robot's clock is its own.
        self._offset_ns = round(robot.clock_offset_s * NS_PER_S)
        self._frame = 1

    def poses(self, until_s: float, robot: Trajectory) -> list[Pose]:
        count = max(0, math.floor(until_s / self._period_s) + 1 - self._frame)
        t_s = np.arange(self._frame, self._frame + count, dtype=np.float64) * self._period_s
        self._frame += count
        p_m, yaw = robot.at(t_s)
        return [
            self._body.pose(self._camera.pose(round(t * NS_PER_S) + self._offset_ns, (p[0], p[1], p[2]), y))
            for t, p, y in zip(t_s.tolist(), p_m.tolist(), yaw.tolist(), strict=True)
        ]


class _Radio:
    """Records of the simulated cards as the service's channel samples, a batch at a time."""

    def __init__(self, scenario: Scenario) -> None:
        self._link = RadioLink(scenario)

    def skip_to(self, t_s: float) -> None:
        self._link.skip_to(t_s)

    def samples(self, until_s: float, uav: Trajectory, beacon: Trajectory) -> list[tuple[bool, ChannelSample]]:
        at_uav, at_beacon = self._link.advance(until_s, uav, beacon)
        return [(True, s) for s in _samples(at_uav, _BEACON)] + [(False, s) for s in _samples(at_beacon, _UAV)]


def _samples(records: list[CsiRecord], peer: int) -> list[ChannelSample]:
    """The same values as `companion.radio.Radio` gives, for all records at once."""
    if not records:
        return []
    csi = np.array([record.csi[:, :, 0] for record in records]).swapaxes(1, 2)
    centre = centre_channel(csi)
    samples = []
    for record, row in zip(records, centre, strict=True):
        values = np.zeros(ANTENNAS, np.complex64)
        values[list(record.antennas)] = row
        t_ns = (record.host_time_ns or 0) - DEFAULT_EPOCH_NS
        samples.append(ChannelSample(peer, record.frame_count or 0, t_ns, record.timestamp_low_us, values))
    return samples
