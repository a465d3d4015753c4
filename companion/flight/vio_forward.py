"""Our poses to the autopilot's estimator, at a rate of their own: how a vehicle flies where there is no GPS.

Without GPS these poses are the vehicle's position, so a jump of the tracker would be flown. It is taken out here: from
then on all poses are moved by what makes them go on where the vehicle is. The `reset_counter` therefore never rises;
PX4 would set its estimate anew by it.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from typing import Final

from companion.autopilot.port import Autopilot, AutopilotError
from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, Vector3
from companion.pose.intake import PoseIntake

_log = logging.getLogger(__name__)
_GAP_S: Final = 0.2
"""After a longer one the autopilot, which has flown on by its own sensors, knows better than a straight line."""
_POSITION_S: Final = 0.5


class VioForwarder:
    """Gets every usable pose and sends on as many as `rate_hz` allows; a failed tracker's are never sent."""

    def __init__(self, autopilot: Autopilot, intake: PoseIntake, rate_hz: float) -> None:
        self._autopilot = autopilot
        self._intake = intake
        self._period_ns = round(NS_PER_S / rate_hz) if rate_hz > 0 else None
        self._due_ns = 0
        self._newest: Pose | None = None
        """As it was, or would have been, sent."""
        self._resets = intake.reset_counter
        self._offset_m: Vector3 = (0.0, 0.0, 0.0)
        self.sent = 0
        self.failed = 0

    def forward(self, pose: Pose) -> None:
        if self._period_ns is None or pose.confidence < 1:
            return
        if self._intake.reset_counter != self._resets:
            self._resets = self._intake.reset_counter
            self._take_out_jump(pose)
        moved = dataclasses.replace(pose, p_enu_m=_sum(pose.p_enu_m, self._offset_m))
        self._newest = moved
        if pose.t_mono_ns < self._due_ns:
            return
        # From the due time, not from now, so that a rate that does not divide the tracker's is kept on average.
        self._due_ns = max(self._due_ns + self._period_ns, pose.t_mono_ns - self._period_ns)
        try:
            self._autopilot.send_odometry(moved, 0)
        except AutopilotError as error:
            if not self.failed:
                _log.warning("pose not forwarded: %s", error)
            self.failed += 1
            return
        self.sent += 1

    def _take_out_jump(self, pose: Pose) -> None:
        """The tracker's frame is another one from this pose on: the vehicle is where it was going to be."""
        goes_on_m = self._expected(pose.t_mono_ns)
        if goes_on_m is None:
            return
        x, y, z = (there - here for there, here in zip(goes_on_m, pose.p_enu_m, strict=True))
        step_m = math.dist((x, y, z), self._offset_m)
        self._offset_m = x, y, z
        _log.warning(
            "the tracker's frame has moved by %.2f m; the poses sent to the autopilot go on without it", step_m
        )

    def _expected(self, t_ns: int) -> Vector3 | None:
        before = self._newest
        if before is None:
            return None
        dt_s = (t_ns - before.t_mono_ns) / NS_PER_S
        if dt_s <= _GAP_S:
            return _sum(before.p_enu_m, _scaled(before.v_enu_m_s, dt_s))
        vehicle = self._autopilot.state()
        if vehicle.p_local_enu_m is None or vehicle.position_mono_ns is None:
            return before.p_enu_m
        since_s = (t_ns - vehicle.position_mono_ns) / NS_PER_S
        if abs(since_s) > _POSITION_S:
            return before.p_enu_m
        return _sum(vehicle.p_local_enu_m, _scaled(vehicle.v_local_enu_m_s or (0.0, 0.0, 0.0), since_s))


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(v: Vector3, factor: float) -> Vector3:
    return v[0] * factor, v[1] * factor, v[2] * factor
