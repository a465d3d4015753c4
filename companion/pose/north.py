"""Where North is for a tracker that starts with any yaw: from the autopilot's heading, over a still period. Pure."""

from __future__ import annotations

import cmath
import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, Vector3
from wsr.geometry import wrap_angle, yaw_of

_PERIOD_S: Final = 3.0
_MIN_SAMPLES: Final = 30
_MAX_SCATTER_RAD: Final = math.radians(3.0)
_STILL_M: Final = 0.3
"""A hover in gusts counts as still; its velocities, differences of noisy positions, would not."""


@dataclass(frozen=True, slots=True)
class North:
    """`yaw_rad`: turn, counter-clockwise, from the tracker's axes to true East and North."""

    yaw_rad: float
    scatter_rad: float
    """Circular standard deviation of the differences it is the mean of."""


class NorthFinder:
    """Compares the heading of the nose as the autopilot and as the tracker (not aligned yet) see it.

    The circular mean of a still period counts, sqrt(-2 ln R) being its standard deviation (Mardia & Jupp, Directional
    Statistics, 2000); a scattered one is refused: a compass beside motors or steel turns with the current.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[int, float]] = deque()
        self._at_m: Vector3 = (0.0, 0.0, 0.0)

    def add(self, t_ns: int, yaw_enu_rad: float, pose: Pose) -> None:
        """A heading of the autopilot and the tracker's pose of the same time. Motion starts the period anew."""
        if self._samples and math.dist(pose.p_enu_m, self._at_m) > _STILL_M:
            self._samples.clear()
        if not self._samples:
            self._at_m = pose.p_enu_m
        self._samples.append((t_ns, yaw_enu_rad - float(yaw_of(pose.q_enu_from_body))))
        while t_ns - self._samples[0][0] > _PERIOD_S * NS_PER_S:
            self._samples.popleft()

    def clear(self) -> None:
        self._samples.clear()

    def north(self) -> North | str:
        """The turn, or why it cannot be told yet."""
        differences = [difference for _, difference in self._samples]
        if len(differences) < _MIN_SAMPLES or self._span_s() < 0.8 * _PERIOD_S:
            return f"North is not known yet: {_PERIOD_S:g} s at rest with headings of the autopilot are needed"
        mean, scatter_rad = circular_mean(differences)
        if scatter_rad > _MAX_SCATTER_RAD:
            return (
                f"North is not known: the autopilot's heading scatters by {math.degrees(scatter_rad):.1f} deg against "
                f"the tracker's, more than {math.degrees(_MAX_SCATTER_RAD):g}"
            )
        return North(float(wrap_angle(mean)), scatter_rad)

    def _span_s(self) -> float:
        return (self._samples[-1][0] - self._samples[0][0]) / NS_PER_S


def circular_mean(angles_rad: list[float]) -> tuple[float, float]:
    """Mean direction and circular standard deviation sqrt(-2 ln R) of angles, R being the mean resultant length."""
    resultant = sum(cmath.rect(1.0, angle) for angle in angles_rad) / len(angles_rad)
    length = min(1.0, abs(resultant))
    return cmath.phase(resultant), math.sqrt(-2 * math.log(length)) if length > 0 else math.inf
