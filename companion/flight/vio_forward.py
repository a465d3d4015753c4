"""Our poses to the autopilot's estimator, at a rate of their own: how a vehicle flies where there is no GPS."""

from __future__ import annotations

import logging

from companion.autopilot.port import Autopilot, AutopilotError
from companion.core.clock import NS_PER_S
from companion.core.messages import Pose
from companion.pose.intake import PoseIntake

_log = logging.getLogger(__name__)


class VioForwarder:
    """Gets every usable pose and sends on as many as `rate_hz` allows; a failed tracker's are never sent."""

    def __init__(self, autopilot: Autopilot, intake: PoseIntake, rate_hz: float) -> None:
        self._autopilot = autopilot
        self._intake = intake
        self._period_ns = round(NS_PER_S / rate_hz) if rate_hz > 0 else None
        self._due_ns = 0
        self.sent = 0
        self.failed = 0

    def forward(self, pose: Pose) -> None:
        if self._period_ns is None or pose.t_mono_ns < self._due_ns or pose.confidence < 1:
            return
        # From the due time, not from now, so that a rate that does not divide the tracker's is kept on average.
        self._due_ns = max(self._due_ns + self._period_ns, pose.t_mono_ns - self._period_ns)
        try:
            self._autopilot.send_odometry(pose, self._intake.reset_counter)
        except AutopilotError as error:
            if not self.failed:
                _log.warning("pose not forwarded: %s", error)
            self.failed += 1
            return
        self.sent += 1
