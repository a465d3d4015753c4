"""What every role has: the card, the camera, the neighbours, the log. Bytes come in and leave as samples and poses."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

from companion import wire
from companion.clock import NS_PER_S
from companion.config import Config
from companion.event_clock import EventClock
from companion.inputs import Inputs
from companion.messages import Pose, pose_bytes
from companion.neighbours import NeighbourReceiver, NeighbourSender
from companion.radio import ChannelSample, Radio
from companion.recorder import Recorder
from companion.streams import CSI, HEALTH, NEIGHBOUR, POSE, POSE_USED
from wsr.displacement import antenna_positions

_POSES_SHOWN_HZ = 50.0


@dataclass(frozen=True, slots=True)
class Health:
    """Counters and ages of every input, once a second."""

    t_mono_ns: int
    radio: dict[str, int]
    source: dict[str, int]
    pose_age_s: float | None
    poses: dict[str, int]
    link: dict[str, int]
    neighbours: dict[str, dict[str, Any]]
    recorder: dict[str, int]


class Node:
    """Opens `inputs` and fans them out. `on_sample` and `on_pose` are called on the event loop.

    Each of `take_csi`, `take_pose` and `take_datagram` handles one event: a replay calls them as the loop does.
    """

    def __init__(
        self,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        inputs: Inputs,
        on_sample: Callable[[ChannelSample], None],
        on_pose: Callable[[Pose], None],
    ) -> None:
        self.config = config
        self.clock = clock
        self.recorder = recorder
        self._on_pose = on_pose
        keys = {peer.id: inputs.key(peer.key_file) for peer in config.peers}
        names = {peer.id: peer.name for peer in config.peers}
        self.receiver = NeighbourReceiver(config.id, names, keys, clock)
        role = wire.Role.UAV if config.role == "uav" else wire.Role.BEACON
        own_key = inputs.key(config.neighbours.key_file)
        self.sender = NeighbourSender(role, config.id, own_key, config.neighbours.pose_rate_hz)
        self._inputs = inputs
        self._source = inputs.open_csi()
        self._radio = Radio(self._source, _macs(config), clock, on_sample, self._record_csi)
        self._poses = inputs.open_poses(self.take_pose)
        self._pose_ns: int | None = None
        self._pose_shown_ns = 0

    async def run(self) -> None:
        """Reads until cancelled, then closes what it opened."""
        loop = asyncio.get_running_loop()
        link = await self._inputs.open_link(self.take_datagram)
        loop.add_reader(self._source.fileno(), self.take_csi)
        loop.add_reader(self._poses.fileno(), self._poses.drain)
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._broadcast(link), name="broadcast")
                tasks.create_task(self._report_health(), name="health")
        finally:
            loop.remove_reader(self._source.fileno())
            loop.remove_reader(self._poses.fileno())
            link.close()
            self._source.close()
            self._poses.close()

    def take_csi(self) -> None:
        """The card has records."""
        with self.clock.event():
            self._radio.drain()

    def take_pose(self, pose: Pose) -> None:
        with self.clock.event():
            self.recorder.record(POSE_USED, pose.t_mono_ns, pose_bytes(pose))
            self._pose_ns = pose.t_mono_ns
            if pose.t_mono_ns - self._pose_shown_ns >= NS_PER_S / _POSES_SHOWN_HZ:
                self._pose_shown_ns = pose.t_mono_ns
                self.recorder.record(POSE, pose.t_mono_ns, pose)
            if self.sender.wants_pose(pose.t_mono_ns):
                antenna_m = antenna_positions(pose.p_enu_m, pose.q_enu_from_body, self.config.pose.antenna_m)
                self.sender.add_pose(pose.t_mono_ns, antenna_m, pose.confidence)
            self._on_pose(pose)

    def take_datagram(self, data: bytes) -> None:
        """A datagram of some robot. What carries a good signature is recorded, taken or not; the rest is only counted:
        anybody can send it, at any rate."""
        with self.clock.event():
            before = replace(self.receiver.counters)
            self.receiver.take(data)
            if self.receiver.counters == before:
                self.recorder.record(NEIGHBOUR, self.clock.now_ns(), data)

    def pose_age_s(self) -> float:
        """Since the newest usable pose; infinite before the first."""
        return math.inf if self._pose_ns is None else (self.clock.now_ns() - self._pose_ns) / NS_PER_S

    def health(self) -> Health:
        now_ns = self.clock.now_ns()
        return Health(
            now_ns,
            asdict(self._radio.counters),
            asdict(self._source.counters),
            None if self._pose_ns is None else self.pose_age_s(),
            {name: getattr(self._poses, name) for name in ("received", "malformed", "not_finite")},
            asdict(self.receiver.counters) | {"dropped": self.sender.dropped},
            {
                n.name: {
                    "accepted": n.accepted,
                    "refused_old": n.refused_old,
                    "age_s": None if n.heard_ns is None else (now_ns - n.heard_ns) / NS_PER_S,
                }
                for n in self.receiver.neighbours.values()
            },
            self.recorder.counters(),
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

    def _record_csi(self, t_mono_ns: int, code: int, body: bytes) -> None:
        self.recorder.record(CSI, t_mono_ns, bytes([code]) + body)


def _macs(config: Config) -> dict[bytes, int]:
    return {bytes.fromhex(peer.mac.replace(":", "")): peer.id for peer in config.peers}
