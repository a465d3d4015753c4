"""Which source the poses come from, as the configuration says."""

from __future__ import annotations

import math

from companion.clock import Clock
from companion.config import Config
from companion.pose.intake import PoseIntake
from companion.pose.port import Poses
from companion.pose.source import PoseSource


def open_poses(config: Config, clock: Clock, intake: PoseIntake) -> Poses:
    """The source, bound to the intake. Raises CompanionError when it cannot be opened."""
    pose, source = config.pose, _source(config, clock, intake)
    intake.bind(source)
    if pose.source != "px4":  # its estimator has found North by itself
        source.align(math.radians(pose.north_yaw_deg))
    return source


def _source(config: Config, clock: Clock, intake: PoseIntake) -> Poses:
    pose = config.pose
    # Imported late: a vehicle needs one of them.
    if pose.source == "natnet":
        from companion.pose.natnet import NatNetPoses

        return NatNetPoses(pose.natnet, clock, intake.take)
    if pose.source == "recording":
        from companion.pose.recording import RecordedPoses

        return RecordedPoses(config.path(pose.recording), clock, intake.take)
    if pose.source == "px4":
        from companion.pose.autopilot import AutopilotPoses

        return AutopilotPoses(intake.take)
    return PoseSource(config.path(pose.socket), 0.0, intake.take)
