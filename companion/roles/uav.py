"""The parts of role uav, wired."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from companion.autopilot.port import Autopilot
from companion.autopilot.snapshot import ObservedAutopilot
from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.inputs import Answer, Surroundings, WorkerState
from companion.core.messages import Pose
from companion.core.recorder import Recorder
from companion.core.streams import ANSWER, WORKER
from companion.flight.commands import FlightCommands, MakeCommands
from companion.flight.loop import Flight
from companion.flight.vio_forward import VioForwarder
from companion.radio.card import ChannelSample
from companion.roles.inputs import Inputs
from companion.roles.node import Node
from companion.sensing.iterations import SarIterations, Worker
from companion.sensing.records import ApertureRecord, Iteration
from companion.sensing.window import SarWindow
from companion.sensing.worker_wire import AoaResult
from wsr.channel import wavelength_m


class Uav:
    """The parts of role uav, wired. What they stand on is given: live, or a log."""

    def __init__(
        self,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        inputs: Inputs,
        make_autopilot: Callable[[Node], Autopilot],
        make_worker: Callable[[Callable[[AoaResult], None], Callable[[bool], None]], Worker],
        make_commands: MakeCommands = FlightCommands,
        look: Callable[[], Surroundings] | None = None,
    ) -> None:
        assert config.autopilot is not None
        aperture = config.aperture
        self._clock = clock
        self._recorder = recorder
        self._refuses_lookalikes = config.neighbours.refuse_lookalikes
        self._window = SarWindow(
            config.pose.antenna_m, wavelength_m(config.csi.channel), aperture.min_packets, aperture.max_pose_gap_s
        )
        self.node = node = Node(config, clock, recorder, self._take_sample, self._take_pose, inputs)
        self._window.nic_clock = node.radio.nic_clock
        self.autopilot = ObservedAutopilot(make_autopilot(node), clock, recorder)
        self._forwarder = VioForwarder(self.autopilot, node.intake, config.autopilot.forward_vio_hz)
        self.sar = SarIterations(
            self._window,
            make_worker(self.take_answer, self.take_worker_state),
            node.receiver.neighbours,
            aperture,
            clock,
            self._take_iteration,
            node.intake.problem_between,
            self._take_aperture,
        )
        self.flight = Flight(
            config,
            clock,
            node.intake,
            node.receiver.neighbours,
            self.autopilot,
            self.sar,
            recorder,
            make_commands,
            look,
            node.network_problem,
        )

    def take_answer(self, result: AoaResult) -> None:
        """The worker has answered."""
        with self._clock.event() as now_ns:
            failure = result.refusal if result.failed else ""
            self._recorder.record(ANSWER, now_ns, Answer(now_ns, result.id, result.peer, result.compute_s, failure))
            self.sar.take(result)

    def take_worker_state(self, is_ready: bool) -> None:
        """A worker has begun or ceased to wait for apertures."""
        with self._clock.event() as now_ns:
            self._recorder.record(WORKER, now_ns, WorkerState(now_ns, is_ready))

    def _take_sample(self, sample: ChannelSample) -> None:
        self._window.add_sample(sample)
        self.flight.heard(sample.peer, sample.t_mono_ns)

    def _take_pose(self, pose: Pose) -> None:
        self._window.add_pose(pose)
        self._forwarder.take(pose)

    def _take_aperture(self, aperture: ApertureRecord) -> None:
        self.flight.take_aperture(aperture)

    def _take_iteration(self, iteration: Iteration, profile: bytes) -> None:
        doubt = self.node.lookalikes.add(iteration.peer, iteration.start_ns, profile)
        if doubt and self._refuses_lookalikes:
            iteration = dataclasses.replace(iteration, estimate=None, refusal=doubt)
        self.flight.take(iteration, profile)
