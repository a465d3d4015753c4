"""The parts of role uav, wired: what each of them makes and who gets it."""

from __future__ import annotations

from collections.abc import Callable

from companion.autopilot.port import Autopilot
from companion.autopilot.snapshot import SnapshotAutopilot
from companion.camera.sighting import TagFrame
from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.inputs import Surroundings
from companion.core.recorder import Recorder
from companion.core.streams import TAG
from companion.flight.commands import FlightCommands, MakeCommands
from companion.flight.loop import Flight
from companion.flight.vio_forward import VioForwarder
from companion.pose.port import PoseSink
from companion.roles.inputs import Inputs
from companion.roles.node import Node
from companion.sensing.iterations import SarIterations, Worker
from companion.sensing.window import SarWindow
from wsr.channel import wavelength_m

MakeAutopilot = Callable[[PoseSink | None], Autopilot]
"""Gets what takes the autopilot's own odometry, where that is the source of poses."""


class Uav:
    """What its parts stand on is given: a vehicle, or a log."""

    def __init__(
        self,
        *,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        inputs: Inputs,
        make_autopilot: MakeAutopilot,
        worker: Worker,
        make_commands: MakeCommands = FlightCommands,
        look: Callable[[], Surroundings] | None = None,
    ) -> None:
        assert config.autopilot is not None
        self._clock, self._recorder = clock, recorder
        self.node = node = Node(config, clock, recorder, inputs)
        self.autopilot = SnapshotAutopilot(make_autopilot(node.odometry_sink()), clock, recorder)
        aperture = config.aperture
        window = SarWindow(
            antenna_m=config.pose.antenna_m,
            wavelength_m=wavelength_m(config.csi.channel),
            min_packets=aperture.min_packets,
            max_pose_gap_s=aperture.max_pose_gap_s,
            nic_clock=node.radio.nic_clock,
        )
        self.sar = SarIterations(
            window=window,
            worker=worker,
            neighbours=node.receiver.neighbours,
            config=aperture,
            clock=clock,
            recorder=recorder,
            lookalikes=node.lookalikes,
            pose_problem=node.intake.problem_between,
            drift=config.pose_drift,
        )
        self.flight = Flight(
            config=config,
            clock=clock,
            intake=node.intake,
            neighbours=node.receiver.neighbours,
            autopilot=self.autopilot,
            sar=self.sar,
            recorder=recorder,
            make_commands=make_commands,
            look=look,
            network_problem=node.network_problem,
        )
        forwarder = VioForwarder(self.autopilot, node.intake, config.autopilot.forward_vio_hz)
        node.samples.connect(window.add_sample, self.flight.knowledge.heard)
        node.poses.connect(window.add_pose, forwarder.forward)
        if self.flight.knowledge.camera is not None:
            node.poses.connect(self.flight.knowledge.camera.add_pose)
        self.sar.iterations.connect(self.flight.knowledge.add_iteration, node.share_iteration)

    def take_tags(self, frame: TagFrame) -> None:
        """The tag camera has looked; recorded where it saw something."""
        with self._clock.event():
            if frame.tags:
                self._recorder.record(TAG, frame.t_mono_ns, frame)
            self.flight.knowledge.take_tags(frame)
