"""One mission at virtual time: the service's own flight, mission, gate, guidance, window, worker and tracker code over
a kinematic vehicle, drifting cameras and the simulated radio.

What is left out of the service: sockets and pipes, parsing of records, the map from card time to host time, the
recorder, take-off and the autopilot (the vehicle starts in a hover and grants every mode at once).
"""

from __future__ import annotations

import asyncio
import logging
import math
import tempfile
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numpy.random import SeedSequence

from companion.config.schema import AutopilotConfig, Config, CsiConfig, MissionConfig, NeighbourConfig, Peer, PoseConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.messages import Pose, Vector3
from companion.flight.loop import Flight
from companion.guidance.target import Target
from companion.mission.table import AT_REST, State
from companion.neighbours import wire
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from companion.pose.intake import PoseIntake
from companion.roles.beacon import Beacon
from companion.sensing.iterations import SarIterations
from companion.sensing.lookalikes import Lookalikes
from companion.sensing.records import Iteration
from companion.sensing.window import SarWindow
from companion.sim.scenario import Scenario
from companion.sim.scenes import fence_in, is_outside
from companion.sim.trajectory import BeaconDrive, Trajectory, VehicleTrack
from companion.study.virtual_clock import VirtualClock
from companion.study.virtual_parts import (
    AIRFRAME_S,
    BEACON_ID,
    UAV_ID,
    CameraFeed,
    InlineWorker,
    NullRecorder,
    RadioFeed,
    Vehicle,
)
from wsr.channel import wavelength_m
from wsr.displacement import antenna_positions

RENDEZVOUS_M = 2.0
_KEY = bytes(wire.MIN_KEY_BYTES)
_BOOT_ID = 1
_START_NS = 5 * NS_PER_S  # apertures and cameras want some past
_BATCH_S = 0.2
_ENGAGING_NS = 10 * NS_PER_S
"""A mission that is still refused then does not begin: what is missing at first comes with the first datagrams."""
LEVER_M: Vector3 = (0.06, 0.03, -0.05)
BEACON_LEVER_M: Vector3 = (0.0, 0.0, 0.5)
CRASHED = "crashed"
_OVER = frozenset({State.IDLE, State.LATCHED, State.FAULT, State.LANDING, State.ARRIVED})

logging.getLogger("companion.flight").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionPoint:
    """One SAR iteration with the truth at its reference point and time; positions of the antennas."""

    iteration: Iteration
    target: Target | None
    """What it made of the target; None where it steered nothing."""
    uav_enu_m: Vector3
    beacon_enu_m: Vector3
    local_off_m: Vector3
    """How far places in the autopilot's local frame then were from the world's."""
    is_beacon_moving: bool
    time_s: float
    """Of the reference point, from engaging."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionResult:
    """Times are from engaging. `end` is the state in which the mission ended, or was in when its time was over."""

    time_s: float
    end: str
    closest_m: float
    reached_s: float | None
    """When the antennas were first within 2 m."""
    arrived_m: float | None
    """How far apart they were when the vehicle called itself arrived, which ends the mission; None if it never did."""
    left_room: bool
    """The vehicle flew into a wall, floor or ceiling, which ended the mission: `end` is then "crashed"."""
    points: list[MissionPoint]


def config() -> Config:
    """The defaults of a vehicle, on channel 108; its files and sockets are never opened, only the disk is looked at."""
    return Config(
        role="uav",
        id=UAV_ID,
        name="uav",
        runtime_dir=tempfile.gettempdir(),
        csi=CsiConfig(channel=108, source="unix"),
        neighbours=NeighbourConfig(key_file="none"),
        peers=[Peer(BEACON_ID, "beacon", "00:21:6A:00:00:02", "none", antenna_height_m=BEACON_LEVER_M[2])],
        pose=PoseConfig(antenna_m=LEVER_M),
        mission=MissionConfig(control="fly"),
        autopilot=AutopilotConfig("none"),
    )


def with_levers(scenario: Scenario) -> Scenario:
    """The scenario with the antennas of both robots off their cameras, as on the vehicles."""
    uav, beacon = (
        replace(robot, antennas_m=((x, y, z), (x, y + 0.06, z), (x, y - 0.06, z)))
        for robot, (x, y, z) in ((scenario.uav, LEVER_M), (scenario.beacon, BEACON_LEVER_M))
    )
    return replace(scenario, uav=uav, beacon=beacon)


def fly(scenario: Scenario, seed: SeedSequence, max_time_s: float, *, chooses_motion: bool = True) -> MissionResult:
    """Until the vehicle calls itself arrived, or ends the mission otherwise. The same arguments give the same one."""
    return asyncio.run(_fly(scenario, seed, max_time_s, chooses_motion=chooses_motion))


async def _fly(scenario: Scenario, seed: SeedSequence, max_time_s: float, *, chooses_motion: bool) -> MissionResult:
    clock = VirtualClock()
    _, gust_seed, wander_seed = (int(word) for word in seed.generate_state(3))
    world = _World(
        scenario=with_levers(scenario),
        gust_seed=gust_seed,
        wander_seed=wander_seed,
        clock=clock,
        max_time_s=max_time_s,
        chooses_motion=chooses_motion,
    )
    flying = asyncio.create_task(world.flight.run())
    await clock.run(world.live)
    ended_in = world.flight.state  # a flight that is cancelled leaves its state
    flying.cancel()
    await asyncio.gather(flying, return_exceptions=True)
    if not flying.cancelled() and (error := flying.exception()) is not None:
        raise error
    return world.result(ended_in)


class _World:
    """Everything around the flight. Physics goes on in small steps, radio and cameras in batches."""

    def __init__(
        self,
        *,
        scenario: Scenario,
        gust_seed: int,
        wander_seed: int,
        clock: VirtualClock,
        max_time_s: float,
        chooses_motion: bool = True,
    ) -> None:
        settings = config()
        # Who knows of a worse camera than a T265 says so.
        drift = max(settings.pose_drift, scenario.vio.bias_std)
        gate, pose = fence_in(scenario.radio, settings.gate), replace(settings.pose, drift=drift)
        settings = replace(settings, gate=gate, pose=pose)
        self._clock = clock
        self._room = scenario.radio
        self._iterations: list[tuple[Iteration, Target | None]] = []
        self._target: Target | None = None
        self._end_ns = _START_NS + round(max_time_s * NS_PER_S)
        self._vehicle = Vehicle(gust_seed, wander_seed, settings.mission.takeoff_height_m, clock)
        self._track, self._drive = VehicleTrack(), BeaconDrive(scenario)
        self._radio = RadioFeed(scenario)
        self._window = SarWindow(
            antenna_m=settings.pose.antenna_m,
            wavelength_m=wavelength_m(settings.csi.channel),
            min_packets=settings.aperture.min_packets,
            max_pose_gap_s=settings.aperture.max_pose_gap_s,
        )
        receiver = NeighbourReceiver(UAV_ID, {BEACON_ID: "beacon"}, {BEACON_ID: (_KEY,)}, clock)
        self._receiver = receiver
        self._sender = NeighbourSender(
            role=wire.Role.BEACON,
            own_id=BEACON_ID,
            key=_KEY,
            pose_rate_hz=settings.neighbours.pose_rate_hz,
            boot_id=_BOOT_ID,
        )
        self._beacon = Beacon(self._sender)
        self._cameras = (CameraFeed(scenario, 0, math.radians(settings.pose.north_yaw_deg)), CameraFeed(scenario, 1))
        self._worker = InlineWorker(settings.aperture.estimator, clock)
        self._intake = PoseIntake(settings.pose, clock, self._cameras[0], self._window.add_pose)
        event_clock, recorder = EventClock(clock), NullRecorder()
        self._sar = SarIterations(
            window=self._window,
            worker=self._worker,
            neighbours=receiver.neighbours,
            config=settings.aperture,
            clock=event_clock,
            recorder=recorder,
            lookalikes=Lookalikes({BEACON_ID: "beacon"}),
            pose_problem=self._intake.problem_between,
            drift=settings.pose_drift,
        )
        self.flight = Flight(
            config=settings,
            clock=event_clock,
            intake=self._intake,
            neighbours=receiver.neighbours,
            autopilot=self._vehicle,
            sar=self._sar,
            recorder=recorder,
            chooses_motion=chooses_motion,
        )
        self._sar.iterations.connect(self.flight.knowledge.add_iteration, self._note_iteration)
        self._beacon_clock_ns = round(scenario.beacon.clock_offset_s * NS_PER_S)
        self._engaging: asyncio.Task[str] | None = None
        self._batch_s = self._step_s = 0.0
        self._truth: list[tuple[float, Vector3, Vector3, Vector3]] = []
        """Time, antennas of both, and how far off the local frame was."""
        self._begun = self._crashed = False
        self._moving_from_s = math.inf

    def live(self, now_ns: int) -> bool:
        """Lives on until `now_ns`; False when the mission is over."""
        now_s = now_ns / NS_PER_S
        while self._step_s + AIRFRAME_S <= now_s:
            self._step_s += AIRFRAME_S
            if self._step_s * NS_PER_S > _START_NS:
                self._vehicle.step()
            self._track.append(self._step_s, self._vehicle.airframe.p_enu_m, self._vehicle.airframe.yaw_enu_rad)
        if now_s - self._batch_s >= _BATCH_S and self._step_s > self._batch_s:
            self._deliver(self._batch_s, self._step_s)
            self._batch_s = self._step_s
        for result in self._worker.due(now_ns):
            self._sar.take_answer(result)
        refused = self._engaging is None or (self._engaging.done() and self._engaging.result())
        if refused and now_ns >= _START_NS:
            self._engaging = asyncio.ensure_future(self.flight.wishes.engage())
        return not self._is_over(now_ns)

    def result(self, ended_in: State) -> MissionResult:
        apart = [math.dist(uav, beacon) for _, uav, beacon, _ in self._truth]
        near_s = [t for (t, *_), apart_m in zip(self._truth, apart, strict=True) if apart_m <= RENDEZVOUS_M]
        start_s = _START_NS / NS_PER_S
        return MissionResult(
            time_s=max(0.0, self._clock.now_ns() / NS_PER_S - start_s),
            end=CRASHED if self._crashed else str(ended_in),
            closest_m=min(apart),
            reached_s=near_s[0] - start_s if near_s else None,
            arrived_m=apart[-1] if ended_in is State.ARRIVED and not self._crashed else None,
            left_room=self._crashed,
            points=self._points(),
        )

    def _note_iteration(self, iteration: Iteration) -> None:
        """After the tracker has had it."""
        before, self._target = self._target, self.flight.knowledge.targets.target
        self._iterations.append((iteration, None if self._target is before else self._target))

    def _is_over(self, now_ns: int) -> bool:
        self._begun |= now_ns > _START_NS + _ENGAGING_NS or self.flight.state not in AT_REST
        over = self._crashed or (self._begun and self.flight.state in _OVER)
        if (over or now_ns >= self._end_ns) and self._step_s > self._batch_s:
            self._note_truth(self._step_s, *self._trajectories(self._batch_s, self._step_s))
        return over or now_ns >= self._end_ns

    def _trajectories(self, from_s: float, until_s: float) -> tuple[Trajectory, Trajectory]:
        """True ones of both robots; a little of the batch before, whose last exchanges are still to be made."""
        since_s = max(0.0, from_s - _BATCH_S)
        return self._track.trajectory(since_s, until_s), self._drive.trajectory(since_s, until_s)

    def _deliver(self, from_s: float, until_s: float) -> None:
        """Poses, packets and datagrams of one batch."""
        uav, beacon = self._trajectories(from_s, until_s)
        self._note_truth(until_s, uav, beacon)
        for pose in self._cameras[0].poses(until_s, uav):
            self._intake.take(pose)
        self._share_poses(self._cameras[1].poses(until_s, beacon))
        # Between legs nothing is measured: one batch now and then shows that the target is there.
        idle = not self._sar.is_measuring and round(until_s / _BATCH_S) % 3
        if idle:
            self._radio.skip_to(until_s)
        else:
            for peer_is_beacon, sample in self._radio.samples(until_s, uav, beacon):
                if peer_is_beacon:
                    self._window.add_sample(sample)
                    self._receiver.neighbours[sample.peer].add_forward(sample.frame, sample.t_mono_ns, sample.nic_us)
                    self.flight.knowledge.heard(sample)
                else:
                    self._beacon.add_sample(sample)
        for datagram in self._sender.datagrams(round(until_s * NS_PER_S) + self._beacon_clock_ns):
            self._receiver.take(datagram)

    def _share_poses(self, poses: list[Pose]) -> None:
        """The beacon's, as its service queues them for the next datagram."""
        if not poses:
            return
        p_m, q_wxyz = np.array([p.p_enu_m for p in poses]), np.array([p.q_enu_from_body for p in poses])
        for pose, antenna_m in zip(poses, antenna_positions(p_m, q_wxyz, BEACON_LEVER_M), strict=True):
            if self._sender.wants_pose(pose.t_mono_ns):
                self._sender.add_pose(pose.t_mono_ns, antenna_m, pose.confidence)

    def _note_truth(self, t_s: float, uav: Trajectory, beacon: Trajectory) -> None:
        at = np.array([t_s])
        u, b = (
            tuple(robot.antennas_at(at, np.array([lever]))[0, 0].tolist())
            for robot, lever in ((uav, LEVER_M), (beacon, BEACON_LEVER_M))
        )
        frame = self._vehicle.airframe
        ex, ey, ez = np.subtract(frame.estimated_p_enu_m, frame.p_enu_m).tolist()
        self._truth.append((t_s, u, b, (ex, ey, ez)))
        self._crashed |= is_outside(self._room, u)
        self._drive.watch(t_s, math.dist(u, b), math.hypot(u[0], u[1]))
        if math.isinf(self._moving_from_s) and any(self._drive.velocity(t_s)):
            self._moving_from_s = t_s

    def _points(self) -> list[MissionPoint]:
        times_s = np.array([t for t, *_ in self._truth])
        ends_m = [np.array([row[i] for row in self._truth]) for i in (1, 2, 3)]
        points = []
        for iteration, target in self._iterations:
            t_s = iteration.reference_ns / NS_PER_S
            uav, beacon, off = (_interpolated(t_s, times_s, p_m) for p_m in ends_m)
            moving = t_s >= self._moving_from_s
            since_s = t_s - _START_NS / NS_PER_S
            points.append(
                MissionPoint(
                    iteration=iteration,
                    target=target,
                    uav_enu_m=uav,
                    beacon_enu_m=beacon,
                    local_off_m=off,
                    is_beacon_moving=moving,
                    time_s=since_s,
                )
            )
        return points


def _interpolated(t_s: float, times_s: npt.NDArray[np.float64], p_m: npt.NDArray[np.float64]) -> Vector3:
    """Of places (N, 3) at times (N,) the one at `t_s`."""
    x, y, z = (float(np.interp(t_s, times_s, p_m[:, axis])) for axis in range(3))
    return x, y, z
