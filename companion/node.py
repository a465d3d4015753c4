"""What every role has: the card, the camera, the neighbours, the log. Bytes come in and leave as samples and poses."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from companion import wire
from companion.boots import BootBook
from companion.broadcast import Link, NeighbourSender
from companion.clock import NS_PER_S, Clock
from companion.config import Config, CsiConfig
from companion.errors import CompanionError
from companion.keys import read_key
from companion.lookalikes import Lookalikes
from companion.messages import Pose
from companion.neighbours import NeighbourReceiver
from companion.pinger import Pinger, open_pinger
from companion.pose.autopilot import AutopilotPoses
from companion.pose.intake import PoseIntake
from companion.pose.opening import open_poses
from companion.pose.reader_process import ReaderProcess
from companion.radio import ChannelSample, Radio
from companion.recorder import Recorder
from companion.streams import CSI, HEALTH, NEIGHBOUR, POSE
from companion.traffic import Traffic
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
    antenna_dbm: dict[str, float | None] = field(default_factory=dict)
    ping: dict[str, float] = field(default_factory=dict)
    interfaces: dict[str, float] = field(default_factory=dict)
    """Bytes per second sent at each interface of the configuration, as the kernel counts them."""
    lookalikes: tuple[tuple[str, str], ...] = ()
    """Pairs of neighbours whose profiles cannot be told apart."""
    card_clock: dict[str, float] = field(default_factory=dict)


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
        names = {peer.id: peer.name for peer in config.peers}
        own_key = read_key(config.path(config.neighbours.key_file))
        is_uav = config.role == "uav"
        self.book = BootBook(config.path(config.state_dir))
        self.receiver = NeighbourReceiver(config.id, names, _keys(config), clock, self.book, we_ping=is_uav)
        role = wire.Role.UAV if is_uav else wire.Role.BEACON
        self.sender = NeighbourSender(
            role,
            config.id,
            own_key,
            config.neighbours.pose_rate_hz,
            self.book.own_boot_id,
            config.neighbours.budget_bytes_s,
        )
        self.lookalikes = Lookalikes(names)
        self._on_sample = on_sample
        self._source = open_csi(config.csi, config)
        self.radio = Radio(self._source, macs(config), clock, self._take_sample, self._record_csi)
        self._pinger: Pinger | None = open_pinger(config, clock)
        self._link: Link | None = None
        self._traffic = Traffic([config.neighbours.interface, config.csi.interface])
        self.intake = PoseIntake(config.pose, clock, self._take_pose)
        self._poses = open_poses(config, clock, self.intake)
        self._reader = ReaderProcess(config.pose.reader_command, clock, self.intake.silence_s)
        self._pose_recorded_ns = 0

    async def run(self) -> None:
        """Reads until cancelled, then closes what it opened."""
        loop = asyncio.get_running_loop()
        self._link = link = Link(self.config)
        readers: list[tuple[int, Callable[[], None]]] = [
            (link.fileno(), self._drain_link),
            (self._source.fileno(), self.radio.drain),
        ]
        if self._pinger is not None:
            readers += [(self._pinger.fileno(), self._pinger.drain)]
        for fileno, drain in readers:
            loop.add_reader(fileno, drain)
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._poses.run(), name="poses")
                if self.config.pose.reader_command:
                    tasks.create_task(self._reader.run(), name="pose reader")
                tasks.create_task(self._broadcast(link), name="broadcast")
                tasks.create_task(self._report_health(), name="health")
                if self._pinger is not None:
                    tasks.create_task(self._pinger.run(), name="ping")
        finally:
            for fileno, _ in readers:
                loop.remove_reader(fileno)
            link.close()
            self._source.close()
            self._poses.close()
            if self._pinger is not None:
                self._pinger.close()
            self.book.close()

    def odometry_sink(self) -> Callable[[Pose], None] | None:
        """What takes the autopilot's own odometry, where that is the source of poses."""
        return self._poses.offer if isinstance(self._poses, AutopilotPoses) else None

    def pose_age_s(self) -> float:
        """Since the newest usable pose; infinite before the first."""
        return self.intake.age_s()

    def health(self) -> Health:
        now_ns = self.clock.now_ns()
        link = asdict(self.receiver.counters) | {
            "dropped": self.sender.dropped,
            "thinned": self.sender.thinned,
            "sent_bytes": self.sender.sent_bytes,
            "unsent": 0 if self._link is None else self._link.unsent,
            "boots_unwritten": int(self.book.failed),
        }
        return Health(
            now_ns,
            asdict(self.radio.counters),
            asdict(self._source.counters),
            None if math.isinf(self.pose_age_s()) else self.pose_age_s(),
            self.intake.report(),
            link,
            {n.name: n.health(now_ns) for n in self.receiver.neighbours.values()},
            {"written": self.recorder.written, "dropped": self.recorder.dropped},
            self.radio.antenna_power(),
            {} if self._pinger is None else self._pinger.health(),
            self._traffic.bytes_per_s(now_ns),
            self.lookalikes.pairs(),
            {"resets": self.radio.nic_clock.resets, "span_s": self.radio.nic_clock.span_s},
        )

    async def _broadcast(self, link: Link) -> None:
        period_ns = round(NS_PER_S / self.config.neighbours.rate_hz)
        while True:
            await self.clock.sleep_until_ns(self.clock.now_ns() + period_ns)
            for datagram in self.sender.datagrams(self.clock.now_ns()):
                link.send(datagram)

    async def _report_health(self) -> None:
        while True:
            await self.clock.sleep_until_ns(self.clock.now_ns() + NS_PER_S)
            for neighbour in self.receiver.neighbours.values():
                neighbour.relate_uncounted(self.clock.now_ns())
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

    def _take_sample(self, sample: ChannelSample) -> None:
        self.receiver.neighbours[sample.peer].add_forward(sample.frame, sample.t_mono_ns, sample.nic_us)
        self._on_sample(sample)

    def _drain_link(self) -> None:
        assert self._link is not None
        for data in self._link.drain():
            if self.receiver.take(data):
                self.recorder.record(NEIGHBOUR, self.clock.now_ns(), data)

    def _record_csi(self, t_mono_ns: int, code: int, body: bytes) -> None:
        self.recorder.record(CSI, t_mono_ns, bytes([code]) + body)


def _keys(config: Config) -> dict[int, list[bytes]]:
    """Every key that is valid, by peer."""
    return {
        peer.id: [read_key(config.path(name)) for name in (peer.key_file, peer.next_key_file) if name is not None]
        for peer in config.peers
    }


def macs(config: Config) -> dict[bytes, int]:
    """Id of each peer by the six bytes of its MAC."""
    return {bytes.fromhex(peer.mac.replace(":", "")): peer.id for peer in config.peers}


def open_csi(csi: CsiConfig, config: Config) -> CsiSource:
    """The configured source. Raises CompanionError."""
    try:
        if csi.source == "unix":
            return UnixSource(config.path(csi.socket), csi.receive_buffer_bytes)
        return NetlinkSource(csi.connector_idx, csi.require_kernel_sender, csi.receive_buffer_bytes)
    except (NetlinkError, UnixSocketError) as error:
        raise CompanionError(f"csi.source {csi.source}: {error}") from None
