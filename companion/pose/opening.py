"""Which source the poses come from, as the configuration says."""

from __future__ import annotations

import math

from companion.config.schema import Config
from companion.core.clock import Clock
from companion.errors import CompanionError
from companion.pose.port import Poses, PoseSink
from companion.pose.source import PoseSource


def open_poses(config: Config, clock: Clock, sink: PoseSink) -> Poses:
    """The source, whose poses go to `sink` once it runs. Raises CompanionError when it cannot be opened."""
    pose, source = config.pose, _source(config, clock, sink)
    if pose.source != "px4":  # its estimator has found North by itself
        source.align(math.radians(pose.north_yaw_deg))
    return source


def _source(config: Config, clock: Clock, sink: PoseSink) -> Poses:
    pose = config.pose
    # Imported late: a vehicle needs one of them.
    if pose.source == "natnet":
        from companion.pose.natnet import NatNetPoses

        return NatNetPoses(pose.natnet, clock, sink)
    if pose.source == "recording":
        from companion.pose.recording import FilePoses

        recording = FilePoses(config.path(pose.recording), clock, sink)
        if not recording.has_attitudes and any(pose.antenna_m):
            raise CompanionError(
                f"pose.recording {pose.recording}: has no attitudes, so the antenna cannot be placed by pose.antenna_m "
                f"{list(pose.antenna_m)}; expected [0, 0, 0]"
            )
        return recording
    if pose.source == "px4":
        from companion.pose.autopilot import AutopilotPoses

        return AutopilotPoses(sink)
    return PoseSource(config.path(pose.socket), 0.0, sink)
