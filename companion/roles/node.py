"""What every role has: the card, the camera, the neighbours, the log. Bytes come in and leave as samples and poses."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from companion.config.schema import Config
from companion.core.clock import NS_PER_S, next_beat_ns
from companion.core.event_clock import EventClock
from companion.core.inputs import BookState, Tick
from companion.core.messages import Pose, pose_bytes
from companion.core.output import Output
from companion.core.recorder import Recorder
from companion.core.streams import BOOK, CSI, HEALTH, NEIGHBOUR, POSE, POSE_IN, SECOND
from companion.host.coalescing import PERIOD_S, TURNS_A_LOOK, CoalescedReaders
from companion.host.ending import Parts
from companion.neighbours import wire
from companion.neighbours.link import Link
from companion.neighbours.receiver import NeighbourReceiver
from companion.neighbours.sender import NeighbourSender
from companion.pose.autopilot import AutopilotPoses
from companion.pose.intake import PoseIntake
from companion.pose.reader_process import ReaderProcess
from companion.radio.card import ChannelSample, Radio
from companion.radio.opening import macs
from companion.radio.pinger import Pinger
from companion.radio.traffic import Traffic
from companion.roles.health import Health
from companion.roles.inputs import Inputs
from companion.sensing.lookalikes import Lookalikes
from companion.sensing.records import Iteration
from companion.team.sent import sighting_of
from wsr.displacement import antenna_position

_POSES_SHOWN_HZ = 50.0


class Node:
    """Opens the inputs of `config`. `samples` gives each packet's channel, `poses` each pose that can be used, on the
    event loop.

    Each of `take_csi`, `take_pose`, `take_datagram` and `each_second` handles one event: a replay calls them as the
    loop does, on `inputs` of a log.
    """

    def __init__(
        self,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        inputs: Inputs,
    ) -> None:
        self.config = config
        self.clock = clock
        self.recorder = recorder
        self.samples = Output[ChannelSample]()
        self.poses = Output[Pose]()
        names = {peer.id: peer.name for peer in config.peers}
        own_key = inputs.key(config.neighbours.key_file)
        is_uav = config.role == "uav"
        self.book = inputs.open_book()
        self._record_book()
        role = wire.Role.UAV if is_uav else wire.Role.BEACON
        self.sender = NeighbourSender(
            role=role,
            own_id=config.id,
            key=own_key,
            pose_rate_hz=config.neighbours.pose_rate_hz,
            boot_id=self.book.own_boot_id,
            budget_bytes_s=config.neighbours.budget_bytes_s,
        )
        self.receiver = NeighbourReceiver(
            config.id,
            names,
            _keys(config, inputs),
            clock,
            book=self.book,
            we_ping=is_uav,
            on_accepted=self.sender.add_heard,
        )
        self.lookalikes = Lookalikes(names, config.neighbours.refuse_lookalikes)
        self._source = inputs.open_csi()
        self.radio = Radio(
            source=self._source,
            peers=macs(config),
            clock=clock,
            on_sample=self.samples.give,
            on_record=self._record_csi,
        )
        self._pinger: Pinger | None = inputs.open_pinger(clock)
        self._link: Link | None = None
        self._readers: CoalescedReaders | None = None
        self._traffic = Traffic([config.neighbours.interface, config.csi.interface])
        self._pose_source = inputs.open_poses(clock, self.take_pose)
        self.intake = PoseIntake(config.pose, clock, self._pose_source, self.poses.give)
        self._reader = ReaderProcess(config.pose.reader_command, clock, self.intake.silence_s)
        self._pose_shown_ns = 0
        self.samples.connect(self._note_exchange)
        self.poses.connect(self._show_pose, self._share_pose)

    def open(self) -> None:
        """What was not opened at the beginning. Raises CompanionError when it cannot be had."""
        self._link = Link(self.config)
        self._reader.check()

    async def run(
        self,
        begin_end: Callable[[BaseException], None] = lambda error: None,
        may_wait: Callable[[], bool] = lambda: False,
    ) -> None:
        """Reads until cancelled, then closes what it opened. `begin_end` is told at once when a part fails; `may_wait`
        says whether what arrives may wait a little, to be read together."""
        loop = asyncio.get_running_loop()
        if self._link is None:
            self.open()
        link = self._link
        assert link is not None
        self._readers = readers = CoalescedReaders(loop, *_turns(self.config), may_wait)
        is_stamped = self._source.is_stamped
        readers.add_reader(
            self._source.fileno(),
            self.take_csi,
            is_stamped=is_stamped,
            gather=self._source.gather if is_stamped else None,
        )
        link.attach(readers, self._drain_link)
        if self._pinger is not None:
            loop.add_reader(self._pinger.fileno(), self._pinger.drain)
        try:
            async with Parts(begin_end) as tasks:
                tasks.create_task(self._pose_source.run(readers), name="poses")
                if self.config.pose.reader_command:
                    tasks.create_task(self._reader.run(), name="pose reader")
                tasks.create_task(self._broadcast(link), name="broadcast")
                tasks.create_task(self._report_health(), name="health")
                if self._pinger is not None:
                    tasks.create_task(self._pinger.run(), name="ping")
        finally:
            readers.remove_reader(self._source.fileno())
            if self._pinger is not None:
                loop.remove_reader(self._pinger.fileno())
            self.close()

    def close(self) -> None:
        """All that is open, sockets with their files. Harmless when repeated."""
        if self._link is not None:
            self._link.close()
        self._source.close()
        self._pose_source.close()
        if self._pinger is not None:
            self._pinger.close()
        self.book.close()

    def read(self) -> None:
        """What has arrived by now is taken, for whoever needs the newest."""
        if self._readers is not None:
            self._readers.read()

    def odometry_sink(self) -> Callable[[Pose], None] | None:
        """What takes the autopilot's own odometry, where that is the source of poses."""
        return self._pose_source.offer if isinstance(self._pose_source, AutopilotPoses) else None

    def take_csi(self) -> int:
        """The card may have records; how many it had."""
        with self.clock.event():
            return self.radio.drain()

    def take_pose(self, pose: Pose) -> None:
        """The source gives a pose, 200 times a second."""
        begun = self.clock.begin()
        try:
            resets = self._pose_source.resets.to_bytes(4, "little")
            self.recorder.record(POSE_IN, pose.t_mono_ns, pose_bytes(pose) + resets)
            self.intake.take(pose)
        finally:
            if begun:
                self.clock.end()

    def take_datagram(self, data: bytes, arrived_ns: int | None = None) -> None:
        """A datagram of some robot, which arrived then, or now. What carries a good signature is recorded, taken or
        not; the rest is only counted: anybody can send it, at any rate."""
        with self.clock.event() as now_ns:
            heard_ns = now_ns if arrived_ns is None else min(arrived_ns, now_ns)
            before = self.receiver.authentic
            self.receiver.take(data, heard_ns)
            if self.receiver.authentic != before:
                self.recorder.record(NEIGHBOUR, heard_ns, data)

    def each_second(self) -> None:
        """What is done once a second."""
        with self.clock.event() as now_ns:
            self.recorder.record(SECOND, now_ns, Tick(now_ns))
            for neighbour in self.receiver.neighbours.values():
                neighbour.relate_uncounted(now_ns)

    def share_iteration(self, iteration: Iteration) -> None:
        """A bearing of our own goes out with the next datagram, as it was measured."""
        sighting = sighting_of(iteration)
        if sighting is not None:
            self.sender.add_sighting(sighting)

    def health(self) -> Health:
        now_ns, pose_age_s = self.clock.now_ns(), self.intake.age_s()
        link = asdict(self.receiver.counters) | {
            "dropped": self.sender.dropped,
            "thinned": self.sender.thinned,
            "sent_bytes": self.sender.sent_bytes,
            "unsent": 0 if self._link is None else self._link.unsent,
            "boots_unwritten": int(self.book.failed),
        }
        return Health(
            t_mono_ns=now_ns,
            radio=asdict(self.radio.counters),
            source=asdict(self._source.counters),
            pose_age_s=None if math.isinf(pose_age_s) else pose_age_s,
            poses=self.intake.report(),
            link=link,
            neighbours={n.name: n.health(now_ns) for n in self.receiver.neighbours.values()},
            recorder=self.recorder.counters(),
            antenna_dbm=self.radio.antenna_power(),
            ping={} if self._pinger is None else self._pinger.health(),
            interfaces=self._traffic.bytes_per_s(now_ns),
            lookalikes=self.lookalikes.pairs(),
            card_clock={"resets": self.radio.nic_clock.resets, "span_s": self.radio.nic_clock.span_s},
            network_problem=self.network_problem(),
        )

    def pose_answer(self, autopilot_yaw_rad: float | None) -> dict[str, Any]:
        """To `companion check-axes`: the newest pose and the autopilot's heading, None without one; or why there is no
        pose to check."""
        self.read()
        pose, problem = self.intake.newest, self.intake.problem()
        if pose is None or problem:
            return {"ok": False, "error": f"no poses to check: {problem or self.intake.north_problem()}"}
        return {"ok": True, **asdict(pose), "autopilot_yaw_rad": autopilot_yaw_rad}

    def network_problem(self) -> str:
        """Why robots cannot be heard or reached; empty while they can."""
        return "" if self._link is None else self._link.problem

    async def _broadcast(self, link: Link) -> None:
        period_ns = round(NS_PER_S / self.config.neighbours.rate_hz)
        while True:
            await self.clock.sleep_until_ns(next_beat_ns(self.clock.now_ns(), period_ns))
            link.watch(self.clock.now_ns())
            for datagram in self.sender.datagrams(self.clock.now_ns()):
                if not link.send(datagram):
                    self.sender.note_unsent(datagram)

    async def _report_health(self) -> None:
        while True:
            await self.clock.sleep_until_ns(next_beat_ns(self.clock.now_ns(), NS_PER_S))
            self.each_second()
            health = self.health()
            self.recorder.record(HEALTH, health.t_mono_ns, health)

    def _show_pose(self, pose: Pose) -> None:
        """For viewers, who need not see them all."""
        if pose.t_mono_ns - self._pose_shown_ns >= NS_PER_S / _POSES_SHOWN_HZ:
            self._pose_shown_ns = pose.t_mono_ns
            self.recorder.record(POSE, pose.t_mono_ns, pose)

    def _share_pose(self, pose: Pose) -> None:
        """Where our antenna was goes out with the next datagram."""
        if self.sender.wants_pose(pose.t_mono_ns):
            antenna_m = antenna_position(pose.p_enu_m, pose.q_enu_from_body, self.config.pose.antenna_m)
            self.sender.add_pose(pose.t_mono_ns, antenna_m, pose.confidence)

    def _note_exchange(self, sample: ChannelSample) -> None:
        self.receiver.neighbours[sample.peer].add_forward(sample.frame, sample.t_mono_ns, sample.nic_us)

    def _drain_link(self) -> int:
        assert self._link is not None
        arrived = self._link.arrivals()
        for data, arrived_ns in arrived:
            self.take_datagram(data, arrived_ns)
        return len(arrived)

    def _record_book(self) -> None:
        reached = {str(peer.id): self.book.reached(peer.id) for peer in self.config.peers}
        with self.clock.event() as now_ns:
            known = {peer: value for peer, value in reached.items() if value is not None}
            self.recorder.record(BOOK, now_ns, BookState(now_ns, known))

    def _record_csi(self, t_mono_ns: int, code: int, body: bytes) -> None:
        self.recorder.record(CSI, t_mono_ns, bytes([code]) + body)


def _turns(config: Config) -> tuple[float, int]:
    """How long what arrives may wait in its socket, and how many such periods to be worked out. Of two poses that reach
    PX4 at once its estimator sees one only, so where poses are forwarded no two that are due may wait."""
    forward_hz = 0.0 if config.autopilot is None else config.autopilot.forward_vio_hz
    return (min(PERIOD_S, 0.5 / forward_hz), 1) if forward_hz else (PERIOD_S, TURNS_A_LOOK)


def _keys(config: Config, inputs: Inputs) -> dict[int, list[bytes]]:
    """Every key that is valid, by peer."""
    return {
        peer.id: [inputs.key(name) for name in (peer.key_file, peer.next_key_file) if name is not None]
        for peer in config.peers
    }
