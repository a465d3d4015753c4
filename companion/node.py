"""What every role has: the card, the camera, the neighbours, the log. Bytes come in and leave as samples and poses."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from companion import wire
from companion.clock import NS_PER_S, Clock
from companion.config import Config, CsiConfig
from companion.errors import CompanionError
from companion.messages import Pose
from companion.neighbours import NeighbourReceiver, NeighbourSender, open_link, read_key
from companion.pose.autopilot import AutopilotPoses
from companion.pose.intake import PoseIntake
from companion.pose.opening import open_poses
from companion.pose.reader_process import ReaderProcess
from companion.radio import ChannelSample, Radio
from companion.recorder import Recorder
from companion.streams import CSI, HEALTH, NEIGHBOUR, POSE
from csi_bridge.netlink import NetlinkError, NetlinkSource
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixSocketError, UnixSource
from wsr.displacement import antenna_positions

_POSES_RECORDED_HZ = 50.0


@dataclass(frozen=True, slots=True)
class Health:
    """Counters and ages of every input, once a second."""

    t_mono_ns: int
    radio: dict[str, int]
    source: dict[str, int]
    pose_age_s: float | None
    poses: dict[str, Any]
    link: dict[str, int]
    neighbours: dict[str, dict[str, Any]]
    recorder: dict[str, int]


class Node:
    """Opens the inputs of `config` and fans them out. `on_sample` and `on_pose` are called on the event loop."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        recorder: Recorder,
        on_sample: Callable[[ChannelSample], None],
        on_pose: Callable[[Pose], None],
    ) -> None:
        self.config = config
        self.clock = clock
        self.recorder = recorder
        self._on_pose = on_pose
        keys = {peer.id: read_key(config.path(peer.key_file)) for peer in config.peers}
        names = {peer.id: peer.name for peer in config.peers}
        self.receiver = NeighbourReceiver(config.id, names, keys, clock)
        role = wire.Role.UAV if config.role == "uav" else wire.Role.BEACON
        own_key = read_key(config.path(config.neighbours.key_file))
        self.sender = NeighbourSender(role, config.id, own_key, config.neighbours.pose_rate_hz)
        self._source = _open_csi(config.csi, config)
        self._radio = Radio(self._source, _macs(config), clock, on_sample, self._record_csi)
        self.intake = PoseIntake(config.pose, clock, self._take_pose)
        self._poses = open_poses(config, clock, self.intake)
        self._reader = ReaderProcess(config.pose.reader_command, clock, self.intake.silence_s)
        self._pose_recorded_ns = 0

    async def run(self) -> None:
        """Reads until cancelled, then closes what it opened."""
        loop = asyncio.get_running_loop()
        link = await open_link(self.config, self._take_datagram)
        loop.add_reader(self._source.fileno(), self._radio.drain)
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._poses.run(), name="poses")
                if self.config.pose.reader_command:
                    tasks.create_task(self._reader.run(), name="pose reader")
                tasks.create_task(self._broadcast(link), name="broadcast")
                tasks.create_task(self._report_health(), name="health")
        finally:
            loop.remove_reader(self._source.fileno())
            link.close()
            self._source.close()
            self._poses.close()

    def odometry_sink(self) -> Callable[[Pose], None] | None:
        """What takes the autopilot's own odometry, where that is the source of poses."""
        return self._poses.offer if isinstance(self._poses, AutopilotPoses) else None

    def pose_age_s(self) -> float:
        """Since the newest usable pose; infinite before the first."""
        return self.intake.age_s()

    def health(self) -> Health:
        now_ns = self.clock.now_ns()
        return Health(
            now_ns,
            asdict(self._radio.counters),
            asdict(self._source.counters),
            None if math.isinf(self.pose_age_s()) else self.pose_age_s(),
            self.intake.report(),
            asdict(self.receiver.counters) | {"dropped": self.sender.dropped},
            {
                n.name: {
                    "accepted": n.accepted,
                    "refused_old": n.refused_old,
                    "age_s": None if n.heard_ns is None else (now_ns - n.heard_ns) / NS_PER_S,
                }
                for n in self.receiver.neighbours.values()
            },
            {"written": self.recorder.written, "dropped": self.recorder.dropped},
        )

    async def _broadcast(self, link: asyncio.DatagramTransport) -> None:
        neighbours = self.config.neighbours
        period_ns = round(NS_PER_S / neighbours.rate_hz)
        while True:
            await self.clock.sleep_until_ns(self.clock.now_ns() + period_ns)
            if (datagram := self.sender.datagram()) is not None:
                link.sendto(datagram, (neighbours.broadcast, neighbours.port))

    async def _report_health(self) -> None:
        while True:
            await self.clock.sleep_until_ns(self.clock.now_ns() + NS_PER_S)
            health = self.health()
            self.recorder.record(HEALTH, health.t_mono_ns, health)

    def _take_pose(self, pose: Pose) -> None:
        if pose.t_mono_ns - self._pose_recorded_ns >= NS_PER_S / _POSES_RECORDED_HZ:
            self._pose_recorded_ns = pose.t_mono_ns
            self.recorder.record(POSE, pose.t_mono_ns, pose)
        if self.sender.wants_pose(pose.t_mono_ns):
            antenna_m = antenna_positions(pose.p_enu_m, pose.q_enu_from_body, self.config.pose.antenna_m)
            self.sender.add_pose(pose.t_mono_ns, antenna_m, pose.confidence)
        self._on_pose(pose)

    def _take_datagram(self, data: bytes) -> None:
        if self.receiver.take(data):
            self.recorder.record(NEIGHBOUR, self.clock.now_ns(), data)

    def _record_csi(self, t_mono_ns: int, code: int, body: bytes) -> None:
        self.recorder.record(CSI, t_mono_ns, bytes([code]) + body)


def _macs(config: Config) -> dict[bytes, int]:
    return {bytes.fromhex(peer.mac.replace(":", "")): peer.id for peer in config.peers}


def _open_csi(csi: CsiConfig, config: Config) -> CsiSource:
    try:
        if csi.source == "unix":
            return UnixSource(config.path(csi.socket), csi.receive_buffer_bytes)
        return NetlinkSource(csi.connector_idx, csi.require_kernel_sender, csi.receive_buffer_bytes)
    except (NetlinkError, UnixSocketError) as error:
        raise CompanionError(f"csi.source {csi.source}: {error}") from None
