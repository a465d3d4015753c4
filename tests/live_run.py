"""A recorded run through the service's own inputs: CSI of each robot into its connector, poses into its socket, UDP
between them. What comes out is compared with the analysis of the files.

Sockets and kernel are real; time is not: it goes on in steps, each as soon as everybody has taken what the step before
brought. So a loaded machine makes it slower, not different. Each robot has a clock of its own, which differs from the
others' by what the clocks of the recording differed.
"""

from __future__ import annotations

import asyncio
import heapq
import math
import socket
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.analysis.bearings import analyze_run
from companion.analysis.result import Options
from companion.analysis.runs import Run, read_truth
from companion.analysis.trajectories import PoseKind, RecordedTrajectory, read_trajectory
from companion.config.schema import AutopilotConfig, Config, CsiConfig, NeighbourConfig, Peer, PoseConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.log.recorder import McapRecorder
from companion.neighbours.keys import write_key
from companion.pose import wire as pose_wire
from companion.roles.beacon import Beacon
from companion.roles.inputs import LiveInputs
from companion.roles.node import Node
from companion.sensing.window import ApertureReport, SarWindow
from companion.sim.stage import free_udp_port
from csi_bridge.netlink import NetlinkFeeder
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiRecord
from csi_bridge.replay import Feeder, Tape, read_tape
from csi_bridge.unix_socket import UnixFeeder
from tests.connectors import UNAVAILABLE, claimed
from wsr.channel import wavelength_m
from wsr.estimators import ESTIMATORS

RX_ID: Final = 1
RX_MAC: Final = {"wsr_dataset_dev": "00:21:6A:53:89:D2", "wsr_3d": "00:21:6A:C5:FC:00"}
_ROBOTS: Final = 4
"""The most in one recording."""
_TAIL_S: Final = 1.0
_ZERO_S: Final = 1000.0
"""On the receiving robot's clock when the tapes start: a host has been up for a while."""
_LONGEST_GAP_S: Final = 0.25
_STEP_NS: Final = 500_000
_STILL_NS: Final = 20_000_000
_TURNS: Final = 4


_Counted = dict[str, dict[int, float]]
"""By sender, when each of its counted frames was heard."""


class Timeline:
    """Time that somebody else moves on, and who waits for it."""

    def __init__(self) -> None:
        self.now_ns = 0
        self._sleepers: list[tuple[int, int, asyncio.Future[None]]] = []
        self._number = 0

    @property
    def next_ns(self) -> float:
        """When the first of them wants to be woken."""
        return self._sleepers[0][0] if self._sleepers else math.inf

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        self._number += 1
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (deadline_ns, self._number, future))
        await future

    async def advance(self, to_ns: int) -> None:
        self.now_ns = to_ns
        while self._sleepers and self._sleepers[0][0] <= to_ns:
            future = heapq.heappop(self._sleepers)[2]
            if not future.done():
                future.set_result(None)
        for _ in range(_TURNS):  # whoever was woken sends, and whoever is sent to reads
            await asyncio.sleep(0)


class RobotClock:
    """The timeline as one robot's host counts it: with another zero, and faster by `drift`. One host of the recordings
    is slewed by 3500 ppm."""

    def __init__(self, timeline: Timeline, offset_s: float, drift: float = 0.0) -> None:
        self._timeline = timeline
        self.offset_ns = round(offset_s * NS_PER_S)
        self.drift = drift

    def now_ns(self) -> int:
        return self._timeline.now_ns + round(self.drift * self._timeline.now_ns) + self.offset_ns

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        await self._timeline.sleep_until_ns(round((deadline_ns - self.offset_ns) / (1 + self.drift)))


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveLink:
    """What the service made of one transmitter, and what the analysis made of it."""

    name: str
    report: ApertureReport
    azimuth_rad: float | None
    polar_rad: float | None
    analysed_azimuth_rad: float | None
    analysed_polar_rad: float | None
    level: bool
    """The polar angle is not observable: only azimuths compare."""
    packets: int
    analysed_packets: int
    health: dict[str, Any]
    true_clock_offset_s: float
    sent_bytes_s: int
    """The most that the transmitter's datagrams took in any second, as an interface counts them."""
    thinned: int
    """Channels it left out to stay below its budget."""

    @property
    def azimuth_apart_rad(self) -> float:
        assert self.azimuth_rad is not None
        assert self.analysed_azimuth_rad is not None
        return abs((self.azimuth_rad - self.analysed_azimuth_rad + np.pi) % (2 * np.pi) - np.pi)

    @property
    def polar_apart_rad(self) -> float:
        assert self.polar_rad is not None
        assert self.analysed_polar_rad is not None
        return abs(self.polar_rad - self.analysed_polar_rad)


@dataclass(slots=True, kw_only=True)
class _Robot:
    """One end: its tape, its clock, its node, and where its hardware's bytes go."""

    config: Config
    tape: Tape
    clock: RobotClock
    play_from_s: float
    """Tape time at the common zero."""
    feeder: Feeder
    node: Node | None = None
    next_record: int = 0
    sent_bytes: list[int] = field(default_factory=list)
    """Of its datagrams, up to each whole second."""
    pose_socket: socket.socket = field(
        default_factory=lambda: socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    )

    def feed(self, now_ns: int) -> None:
        reached_s = self.play_from_s + (1 + self.clock.drift) * now_ns / NS_PER_S
        last = int(np.searchsorted(self.tape.t_s, reached_s, "right"))
        for code, body in self.tape.records[self.next_record : last]:
            self.feeder.send(code, body)
        self.next_record = max(self.next_record, last)

    @property
    def due_ns(self) -> float:
        """When its next record is."""
        if self.next_record == len(self.tape.t_s):
            return math.inf
        return (float(self.tape.t_s[self.next_record]) - self.play_from_s) / (1 + self.clock.drift) * NS_PER_S

    def send_pose(self, t_ns: int, p_m: tuple[float, float, float]) -> None:
        raw = pose_wire.RawPose(
            t_mono_ns=t_ns,
            position_m=p_m,
            quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            velocity_m_s=(0.0, 0.0, 0.0),
            confidence=3,
            frame=pose_wire.PoseFrame.ENU,
        )
        self.pose_socket.sendto(pose_wire.encode(raw), str(self.config.path(self.config.pose.socket)))


def transport() -> tuple[str, str]:
    """netlink where this machine permits it, else unix with the reason."""
    return ("netlink", "") if UNAVAILABLE is None else ("unix", UNAVAILABLE)


async def run_live(run: Run, kind: PoseKind, folder: Path) -> list[LiveLink]:
    """Plays all of `run` and cuts one aperture for each transmitter."""
    with claimed(_ROBOTS) as connectors:
        return await _run_on(connectors, run, kind, folder)


async def _run_on(connectors: list[int], run: Run, kind: PoseKind, folder: Path) -> list[LiveLink]:
    assert run.rx is not None
    trajectory = read_trajectory(run.trajectories[kind], kind)
    rx, tapes = read_tape(run.rx), {name: read_tape(path) for name, path in sorted(run.tx.items())}
    analysed = {link.name: link for link in analyze_run(run, Options(kind=kind)).links}
    names = [name for name in tapes if analysed[name].estimate is not None]
    assert run.truth is not None
    channel = read_truth(run.truth).channel
    timeline = Timeline()
    robots = _robots(
        run,
        {name: analysed[name].mac or "" for name in names},
        rx,
        tapes,
        folder=folder,
        timeline=timeline,
        channel=channel,
        connectors=connectors,
    )
    uav, beacons = robots[0], robots[1:]
    clock = EventClock(uav.clock)
    recorder = McapRecorder(folder / "log.mcap", uav.config, clock)
    uav.node = node = Node(uav.config, clock, recorder, LiveInputs(uav.config))
    window = SarWindow(
        antenna_m=(0.0, 0.0, 0.0),
        wavelength_m=wavelength_m(channel),
        min_packets=20,
        max_pose_gap_s=_LONGEST_GAP_S,
        nic_clock=node.radio.nic_clock,
    )
    node.samples.connect(window.add_sample)
    node.poses.connect(window.add_pose)
    for robot in beacons:
        robot.node = _beacon_node(robot, recorder)
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(robot.node.run()) for robot in robots if robot.node is not None]
        await _play(timeline, robots, trajectory, rx.duration_s + _TAIL_S)
        links = []
        end_ns = uav.clock.now_ns()
        for number, name in enumerate(names, 2):
            neighbour = uav.node.receiver.neighbours[number]
            report = window.cut(neighbour, uav.clock.offset_ns, end_ns)
            estimate = None
            if report.aperture is not None:
                estimate, _ = ESTIMATORS["robust"]().estimate(report.aperture)
            theirs = analysed[name].estimate
            assert theirs is not None
            robot = beacons[number - 2]
            assert robot.node is not None
            links.append(
                LiveLink(
                    name=name,
                    report=report,
                    azimuth_rad=None if estimate is None else estimate.azimuth_rad,
                    polar_rad=None if estimate is None else estimate.polar_rad,
                    analysed_azimuth_rad=theirs.azimuth_rad,
                    analysed_polar_rad=theirs.polar_rad,
                    level=not theirs.polar_observable,
                    packets=0 if estimate is None else estimate.packets,
                    analysed_packets=theirs.packets,
                    health=neighbour.health(uav.clock.now_ns()),
                    true_clock_offset_s=(robot.clock.now_ns() - end_ns) / NS_PER_S,
                    sent_bytes_s=int(np.diff(robot.sent_bytes).max()),
                    thinned=robot.node.sender.thinned,
                )
            )
        for task in running:
            task.cancel()
    recorder.close()
    for robot in robots:
        robot.pose_socket.close()
        robot.feeder.close()
    return links


def _beacon_node(robot: _Robot, recorder: Recorder) -> Node:
    node = Node(robot.config, EventClock(robot.clock), recorder, LiveInputs(robot.config))
    node.samples.connect(Beacon(node.sender).add_sample)
    return node


async def _play(timeline: Timeline, robots: list[_Robot], trajectory: RecordedTrajectory, duration_s: float) -> None:
    uav = robots[0]
    keep = np.isfinite(trajectory.p_enu_m).all(axis=1)
    pose_s, pose_m = trajectory.t_s[keep] - uav.play_from_s, trajectory.p_enu_m[keep]
    next_pose = int(np.searchsorted(pose_s, 0.0, "right"))
    due_ns = 0.0
    for now_ns in range(0, round(duration_s * NS_PER_S), _STEP_NS):
        if now_ns < due_ns - _STEP_NS:
            continue  # nothing happens
        last = int(np.searchsorted(pose_s, now_ns / NS_PER_S, "right"))
        for number in range(next_pose, last):
            x, y, z = pose_m[number].tolist()
            uav.send_pose(round(pose_s[number] * NS_PER_S) + uav.clock.offset_ns, (x, y, z))
        next_pose = max(next_pose, last)
        for robot in robots:
            assert robot.node is not None
            if now_ns % NS_PER_S == 0:
                robot.sent_bytes.append(robot.node.sender.sent_bytes)
            robot.feed(now_ns)
            if robot is not uav and now_ns % _STILL_NS == 0:
                robot.send_pose(robot.clock.now_ns(), (0.0, 0.0, 0.0))
        await timeline.advance(now_ns)
        pose_ns = pose_s[next_pose] * NS_PER_S if next_pose < len(pose_s) else math.inf
        still_ns = (now_ns // _STILL_NS + 1) * _STILL_NS
        due_ns = min(still_ns, pose_ns, timeline.next_ns, *(robot.due_ns for robot in robots))


def _robots(
    run: Run,
    macs: dict[str, str],
    rx: Tape,
    tapes: dict[str, Tape],
    *,
    folder: Path,
    timeline: Timeline,
    channel: int,
    connectors: list[int],
) -> list[_Robot]:
    """The receiving robot first. Tapes start together as the air did; clocks differ as they did."""
    kind, _ = transport()
    rx_mac = next(mac for part, mac in RX_MAC.items() if part in str(run.folder.resolve()))
    port = free_udp_port("127.255.255.255")
    ids = {name: number for number, name in enumerate(macs, 2)}
    start_s = float(rx.t_s[0]) - 0.05
    heard = _counted(rx)
    robots = []
    for name in ("rx", *ids):
        place = folder / name
        place.mkdir(parents=True)
        write_key(place / "own.key")
    for name, number in [("rx", RX_ID), *ids.items()]:
        place = folder / name
        peers = (
            [Peer(ids[tx], tx, mac, str(folder / tx / "own.key")) for tx, mac in macs.items()]
            if name == "rx"
            else [Peer(RX_ID, "rx", rx_mac, str(folder / "rx" / "own.key"))]
        )
        index = connectors[number - 1]
        config = Config(
            role="uav" if name == "rx" else "beacon",
            id=number,
            name=name,
            csi=CsiConfig(
                channel,
                "netlink" if kind == "netlink" else "unix",
                index,
                require_kernel_sender=False,
                receive_buffer_bytes=16 << 20,
            ),
            neighbours=NeighbourConfig(key_file="own.key", port=port, broadcast="127.255.255.255"),
            peers=peers,
            runtime_dir=str(place),
            state_dir="state",
            pose=PoseConfig(),
            autopilot=AutopilotConfig("udpin://127.0.0.1:1") if name == "rx" else None,
        )
        offset_s, drift = (
            (0.0, 0.0)
            if name == "rx"
            else clock_line(heard, _counted(tapes[name]), macs[name], rx_mac, start_s=float(rx.t_s[0]))
        )
        feeder: Feeder = NetlinkFeeder(index) if kind == "netlink" else UnixFeeder(place / "csi.sock")
        # The recorded clocks set those of the beacons; a tape plays when the air carried it.
        clock = RobotClock(timeline, _ZERO_S + offset_s, drift)
        tape = rx if name == "rx" else tapes[name]
        robots.append(_Robot(config=config, tape=tape, clock=clock, play_from_s=start_s + offset_s, feeder=feeder))
    return robots


def clock_line(rx: _Counted, tx: _Counted, mac: str, rx_mac: str, *, start_s: float) -> tuple[float, float]:
    """Wall clock of the transmitter's recording less that of the receiver's at `start_s`, and its drift, from the
    counters both logs share; zeros where they have none, since such recordings agree."""
    ours, theirs = rx.get(mac, {}), tx.get(rx_mac, {})
    common = sorted(ours.keys() & theirs.keys() - {-1})
    if len(common) < 20:
        return 0.0, 0.0
    since_s = np.array([ours[frame] for frame in common]) - start_s
    parts = np.array_split(np.stack([since_s, np.array([theirs[frame] - ours[frame] for frame in common])]), 8, axis=1)
    t_s, apart_s = np.array([np.median(part, axis=1) for part in parts]).T
    drift, offset_s = np.polyfit(t_s, apart_s, 1)
    return float(offset_s), float(drift)


def _counted(tape: Tape) -> _Counted:
    found: _Counted = {}
    for (code, body), t_s in zip(tape.records, tape.t_s.tolist(), strict=True):
        record = parse_body(code, body)
        if isinstance(record, CsiRecord) and record.mac is not None and record.frame_count is not None:
            found.setdefault(record.mac.hex(":").upper(), {})[record.frame_count] = t_s
    return found
