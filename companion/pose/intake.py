"""Between a source of poses and everything that uses them: judged, turned to North, and told when they began anew."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any

from companion.config.schema import PoseConfig
from companion.core.clock import Clock
from companion.core.messages import Pose
from companion.pose.health import HealthLimits, PoseHealth
from companion.pose.north import North, NorthFinder
from companion.pose.port import Poses

_log = logging.getLogger(__name__)


class PoseIntake:
    """Its `take` is the sink of the source; `on_pose` gets the poses that can be used, North-aligned.

    A tracker that began anew has a new yaw. From then on, and from the start where `pose.north` is `autopilot`, poses
    are held back until the autopilot's heading has told where North is: a bearing in turned axes would be worse than
    none.
    """

    def __init__(self, config: PoseConfig, clock: Clock, source: Poses, on_pose: Callable[[Pose], None]) -> None:
        self._clock = clock
        self._source = source
        self._on_pose = on_pose
        self._health = PoseHealth(
            HealthLimits(stale_s=config.stale_s, min_confidence=config.min_confidence, min_rate_hz=config.min_rate_hz)
        )
        self._finder = NorthFinder()
        self._source_resets = 0
        self._jumps = 0
        self._is_aligned = config.north == "config"
        self._fixed = config.source in _TRUE_NORTH
        self.north_rad = math.radians(config.north_yaw_deg)
        self.reset_counter = 0
        """Rises when the tracker began anew or jumped: its frame is no longer the one before."""

    def take(self, pose: Pose) -> None:
        now_ns = self._clock.now_ns()
        if self._source.resets != self._source_resets:
            self._source_resets = self._source.resets
            self._begin_anew(now_ns)
        if not self._health.take(pose, now_ns):
            return
        if self._health.counts["jump"] != self._jumps:
            self._jumps = self._health.counts["jump"]
            self.reset_counter += 1
        if self._is_aligned:
            self._on_pose(pose)

    def add_heading(self, t_ns: int, yaw_enu_rad: float) -> None:
        """The autopilot's heading now; it tells where North is while that is not known."""
        pose = self._health.newest
        if self._is_aligned or pose is None or self._health.age_s(t_ns) > 0.1:
            return
        self._finder.add(t_ns, yaw_enu_rad, pose)
        north = self._finder.north()
        if isinstance(north, North):
            self.north_rad += north.yaw_rad
            self._source.align(self.north_rad)
            self._health.note_reset(t_ns)
            self._is_aligned = True
            _log.info(
                "North found: the tracker's axes are turned by %.1f deg (scatter %.1f deg)",
                math.degrees(self.north_rad), math.degrees(north.scatter_rad),
            )  # fmt: skip

    def age_s(self) -> float:
        """Since the newest pose that can be used; infinite while North is not known."""
        return self._health.age_s(self._clock.now_ns()) if self._is_aligned else math.inf

    @property
    def newest(self) -> Pose | None:
        """The newest usable pose, North-aligned; None before the first and while North is not known."""
        return self._health.newest if self._is_aligned else None

    def silence_s(self) -> float:
        """Since the newest pose that came at all."""
        return self._health.age_s(self._clock.now_ns())

    def is_lost(self) -> bool:
        """Whether the tracker itself shows that it has failed."""
        return self._health.is_lost(self._clock.now_ns())

    def problem(self) -> str:
        return self._health.status(self._clock.now_ns()).problem

    def problem_between(self, start_ns: int, end_ns: int) -> str:
        """Why an aperture between two times cannot be trusted; empty when it can."""
        return self._health.problem_between(start_ns, end_ns)

    def north_problem(self) -> str:
        """Why North is not known; empty when it is."""
        north = "" if self._is_aligned else self._finder.north()
        return north if isinstance(north, str) else ""

    def report(self) -> dict[str, Any]:
        """For the log and the status."""
        status = self._health.status(self._clock.now_ns())
        return {
            "received": self._source.received,
            "malformed": self._source.malformed,
            "resets": self._source.resets,
            "rate_hz": status.rate_hz,
            "confidence": status.confidence,
            "lost": status.is_lost,
            "problem": status.problem or self.north_problem(),
            "north_deg": math.degrees(self.north_rad),
            **{name.replace(" ", "_"): count for name, count in self._health.counts.items()},
        }

    def _begin_anew(self, now_ns: int) -> None:
        _log.warning("the tracker began anew; its poses wait until North is known again")
        self.reset_counter += 1
        self._health.note_reset(now_ns)
        self._finder.clear()
        self._is_aligned = self._fixed


_TRUE_NORTH = frozenset({"px4", "natnet", "recording"})
"""Sources whose frame does not turn when they begin anew."""
