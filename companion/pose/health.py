"""Whether poses can be trusted: rate, age, confidence, numbers, jumps, stalls. Pure; the caller brings the time.

A T265 that is lost sends NaN at full rate, falls silent for 3 to 7 s, or jumps while it claims full confidence. A pose
that cannot be used is not passed on; what cannot be trusted is remembered with its time, and an aperture that it
touches is dropped (`problem_between`).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from companion.core.clock import NS_PER_S, age_s
from companion.core.messages import Pose

_KEPT: Final = 256
_RATE_WINDOW_NS: Final = NS_PER_S
_AHEAD_NS: Final = NS_PER_S // 20
"""How far a pose may be ahead of us: one of a later time would look fresh until then, and all after it too old."""
_FARTHEST_M: Final = 1e5
_FASTEST_M_S: Final = 200.0
_MOST_NORM_OFF: Final = 0.1
_TIPPED: Final = 0.5
"""Cosine of the tilt at which a robot lies on its side: 60 degrees, as in recorded trajectories."""
_REASONS: Final = (
    "not finite", "not plausible", "failed", "future", "jump", "low confidence", "low rate", "gap", "stall", "disorder",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthLimits:
    """Limits of a trustworthy stream of poses."""

    stale_s: float = 0.2
    """A longer gap spoils the aperture."""
    failed_s: float = 0.04
    """A tracker that sends nothing but unusable poses for so long has lost itself: nothing waits for it any more."""
    max_step_m: float = 0.1
    max_speed_m_s: float = 20.0
    min_confidence: int = 2
    min_rate_hz: float = 20.0
    stall_s: float = 0.5
    """A tracker that claims to move and repeats the same pose for so long stands still itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseStatus:
    """For the log, the status and the preflight. Ages are infinite before the first pose."""

    age_s: float
    rate_hz: float
    confidence: int
    is_lost: bool
    problem: str
    """What is wrong now; empty when nothing is."""


class PoseHealth:
    """Takes every pose of one source in the order it comes."""

    def __init__(self, limits: HealthLimits) -> None:
        self._limits = limits
        self._newest: Pose | None = None
        self._moved_ns = 0
        self._failing_ns: int | None = None
        self._arrivals: deque[int] = deque(maxlen=1000)
        self._whole_ns = 0
        """Since when the poses have come without a gap."""
        self._spoiled: deque[tuple[int, int, str]] = deque(maxlen=_KEPT)
        self.counts = dict.fromkeys(_REASONS, 0)

    @property
    def newest(self) -> Pose | None:
        """The newest usable pose."""
        return self._newest

    def take(self, pose: Pose, now_ns: int) -> bool:
        """Whether this pose can be used at all."""
        if not _is_plausible(pose):  # nor is what is not finite
            return self._refuse("not plausible" if _is_finite(pose) else "not finite", now_ns)
        if pose.confidence < 1:
            return self._refuse("failed", now_ns)
        if pose.t_mono_ns - now_ns > _AHEAD_NS:
            return self._refuse("future", now_ns)
        if self._newest is not None and pose.t_mono_ns <= self._newest.t_mono_ns:
            self.counts["disorder"] += 1
            return False
        self._failing_ns = None
        self._arrivals.append(pose.t_mono_ns)
        self._judge(pose)
        self._newest = pose
        return True

    def note_reset(self, t_ns: int) -> None:
        """The tracker began anew: its frame is another one."""
        self._spoil(t_ns, t_ns, "the tracker began anew")
        self._newest = None

    def is_lost(self, now_ns: int) -> bool:
        """Whether the tracker itself shows that it has failed. Silence shows in the age instead."""
        return self._failing_ns is not None and now_ns - self._failing_ns >= self._limits.failed_s * NS_PER_S

    def age_s(self, now_ns: int) -> float:
        return age_s(None if self._newest is None else self._newest.t_mono_ns, now_ns)

    def status(self, now_ns: int) -> PoseStatus:
        age_s, rate_hz = self.age_s(now_ns), self._rate_hz(now_ns)
        confidence = 0 if self._newest is None else self._newest.confidence
        limits = self._limits
        problems = {
            "no poses": self._newest is None,
            "the tracker has lost itself": self.is_lost(now_ns),
            f"poses are {age_s:.1f} s old": limits.stale_s < age_s < math.inf,
            f"only {rate_hz:.0f} poses a second": age_s <= limits.stale_s and rate_hz < limits.min_rate_hz,
            f"tracker confidence {confidence}": age_s <= limits.stale_s and confidence < limits.min_confidence,
            "the robot lies on its side or back: pose.natnet.up, or how the camera is mounted": self._is_tipped(),
        }
        problem = next((text for text, holds in problems.items() if holds), "")
        return PoseStatus(
            age_s=age_s, rate_hz=rate_hz, confidence=confidence, is_lost=self.is_lost(now_ns), problem=problem
        )

    def _is_tipped(self) -> bool:
        """Whether the newest pose's body axis up is nearer to the horizon, or below it, than to Up."""
        if self._newest is None:
            return False
        w, x, y, z = self._newest.q_enu_from_body
        return w * w - x * x - y * y + z * z < _TIPPED * (w * w + x * x + y * y + z * z)

    def problem_between(self, start_ns: int, end_ns: int) -> str:
        """Why an aperture between two times cannot be trusted; empty when it can."""
        for first_ns, last_ns, reason in self._spoiled:
            if first_ns <= end_ns and last_ns >= start_ns:
                return f"poses: {reason}"
        if self._newest is None or end_ns - self._newest.t_mono_ns > self._limits.stale_s * NS_PER_S:
            return "poses: gap"
        return ""

    def _judge(self, pose: Pose) -> None:
        limits, before = self._limits, self._newest
        if pose.confidence < limits.min_confidence:
            self._note(pose.t_mono_ns, pose.t_mono_ns, "low confidence")
        if before is None:
            self._moved_ns = self._whole_ns = pose.t_mono_ns
            return
        span_ns = pose.t_mono_ns - before.t_mono_ns
        step_m = math.dist(pose.p_enu_m, before.p_enu_m)
        if span_ns > limits.stale_s * NS_PER_S:
            self._note(before.t_mono_ns, pose.t_mono_ns, "gap")
            self._whole_ns = pose.t_mono_ns
        self._judge_rate(pose.t_mono_ns)
        # Over a gap the vehicle may have moved on: only its speed can tell a jump then.
        if step_m > limits.max_speed_m_s * span_ns / NS_PER_S or (
            step_m > limits.max_step_m and span_ns <= limits.stale_s * NS_PER_S
        ):
            self._note(before.t_mono_ns, pose.t_mono_ns, "jump")
        if (pose.p_enu_m, pose.q_enu_from_body) != (before.p_enu_m, before.q_enu_from_body) or not any(pose.v_enu_m_s):
            self._moved_ns = pose.t_mono_ns
        elif pose.t_mono_ns - self._moved_ns > limits.stall_s * NS_PER_S:
            self._note(self._moved_ns, pose.t_mono_ns, "stall")

    def _judge_rate(self, t_ns: int) -> None:
        """A tracker that has come without a gap for long enough to tell, and too seldom."""
        while t_ns - self._arrivals[0] >= _RATE_WINDOW_NS:
            self._arrivals.popleft()
        is_low = len(self._arrivals) < self._limits.min_rate_hz * _RATE_WINDOW_NS / NS_PER_S
        if is_low and t_ns - self._whole_ns >= _RATE_WINDOW_NS:
            self._note(t_ns - _RATE_WINDOW_NS, t_ns, "low rate")

    def _refuse(self, reason: str, now_ns: int) -> bool:
        self._failing_ns = now_ns if self._failing_ns is None else self._failing_ns
        self._note(now_ns, now_ns, reason)
        return False

    def _note(self, first_ns: int, last_ns: int, reason: str) -> None:
        self.counts[reason] += 1
        self._spoil(first_ns, last_ns, reason)

    def _spoil(self, first_ns: int, last_ns: int, reason: str) -> None:
        """A reason that goes on lengthens its own entry, so that a bad second does not push out older ones."""
        if self._spoiled:
            begun_ns, until_ns, of = self._spoiled[-1]
            if of == reason and first_ns - until_ns < self._limits.stale_s * NS_PER_S:
                self._spoiled[-1] = begun_ns, max(until_ns, last_ns), reason
                return
        self._spoiled.append((first_ns, last_ns, reason))

    def _rate_hz(self, now_ns: int) -> float:
        return float(sum(now_ns - t_ns < _RATE_WINDOW_NS for t_ns in self._arrivals))


def _is_finite(pose: Pose) -> bool:
    values = (*pose.p_enu_m, *pose.q_enu_from_body, *pose.v_enu_m_s)
    return all(map(math.isfinite, values)) and any(pose.q_enu_from_body)


def _is_plausible(pose: Pose) -> bool:
    """Whether anything of ours can be there, as fast, and turned so: else its numbers are no pose."""
    return (
        math.hypot(*pose.p_enu_m) < _FARTHEST_M
        and math.hypot(*pose.v_enu_m_s) < _FASTEST_M_S
        and abs(math.hypot(*pose.q_enu_from_body) - 1.0) < _MOST_NORM_OFF
    )
