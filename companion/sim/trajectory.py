"""True motion: sampled trajectories, and the beacon's drive."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3
from companion.sim.scenario import Scenario

Array = npt.NDArray[np.float64]

_BEACON_STREAM: Final = 1
_STEP_S: Final = 0.01
_RAMP_M_S2: Final = 0.2
_KEPT_SAMPLES: Final = 400


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Samples of a robot's true motion: t_s (N,) rising, p_enu_m (N, 3), yaw_rad (N,) without jumps of 2 pi.

    Robots stay level: attitude is yaw alone.
    """

    t_s: Array
    p_enu_m: Array
    yaw_rad: Array

    def at(self, t_s: Array) -> tuple[Array, Array]:
        """Positions (M, 3) and yaw (M,) at t_s (M,), linear between samples, held beyond the ends."""
        if len(self.t_s) == 1:
            return np.repeat(self.p_enu_m, len(t_s), axis=0), np.repeat(self.yaw_rad, len(t_s))
        after = np.minimum(np.maximum(np.searchsorted(self.t_s, t_s), 1), len(self.t_s) - 1)
        start_s = self.t_s[after - 1]
        share = np.minimum(np.maximum((t_s - start_s) / (self.t_s[after] - start_s), 0.0), 1.0)
        before_m, before_rad = self.p_enu_m[after - 1], self.yaw_rad[after - 1]
        p_enu_m = before_m + share[:, None] * (self.p_enu_m[after] - before_m)
        return p_enu_m, before_rad + share * (self.yaw_rad[after] - before_rad)

    def antennas_at(self, t_s: Array, levers_m: Array) -> Array:
        """Antenna positions (M, A, 3) for lever arms (A, 3) in body axes (forward, left, up)."""
        p_enu_m, yaw_rad = self.at(t_s)
        cos, sin = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
        antennas_m = np.empty((len(t_s), len(levers_m), 3))
        antennas_m[..., 0] = cos * levers_m[:, 0] - sin * levers_m[:, 1]
        antennas_m[..., 1] = sin * levers_m[:, 0] + cos * levers_m[:, 1]
        antennas_m[..., 2] = levers_m[:, 2]
        antennas_m += p_enu_m[:, None]
        return antennas_m


class VehicleTrack:
    """The newest true states of the vehicle, from which the trajectory of a time slot is cut."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, Vector3, float]] = deque(maxlen=_KEPT_SAMPLES)

    @property
    def newest_s(self) -> float | None:
        """Time of the newest sample; None before the first."""
        return self._samples[-1][0] if self._samples else None

    def append(self, t_s: float, p_enu_m: Vector3, yaw_rad: float) -> None:
        """Samples that are not newer than the newest are ignored. Yaw is unwrapped here."""
        if self._samples:
            newest_s, _, newest_yaw_rad = self._samples[-1]
            if t_s <= newest_s:
                return
            yaw_rad = newest_yaw_rad + math.remainder(yaw_rad - newest_yaw_rad, math.tau)
        self._samples.append((t_s, p_enu_m, yaw_rad))

    def trajectory(self, from_s: float, until_s: float) -> Trajectory:
        """The samples around [from_s, until_s]; needs at least one sample."""
        chosen: list[tuple[float, Vector3, float]] = []
        for sample in reversed(self._samples):
            if sample[0] >= until_s:
                chosen = [sample]
                continue
            chosen.append(sample)
            if sample[0] <= from_s:
                break
        chosen.reverse()
        times, positions, yaws = zip(*chosen, strict=True)
        return Trajectory(np.array(times), np.array(positions), np.array(yaws))


class BeaconDrive:
    """The ground robot: stands still, then drives straight with a short ramp of its speed."""

    def __init__(self, scenario: Scenario) -> None:
        drawn = np.random.default_rng([scenario.seed, _BEACON_STREAM]).uniform(-math.pi, math.pi, 2)
        given = (scenario.beacon_azimuth_rad, scenario.drive_azimuth_rad)
        azimuth_rad, self.yaw_rad = (float(d) if g is None else g for g, d in zip(given, drawn, strict=True))
        self._start_m = scenario.start_distance_m * np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0])
        self._heading = np.array([math.cos(self.yaw_rad), math.sin(self.yaw_rad), 0.0])
        self._speed_m_s = scenario.drive_speed_m_s
        self._go_below_m = scenario.start_distance_m * scenario.drive_below_share
        self._go_s: float | None = None

    def watch(self, t_s: float, distance_m: float) -> None:
        """Starts the drive at t_s once the distance is below its share; later calls change nothing."""
        if self._go_s is None and distance_m < self._go_below_m:
            self._go_s = t_s

    def trajectory(self, from_s: float, until_s: float) -> Trajectory:
        """Samples at most 10 ms apart that cover [from_s, until_s]."""
        steps = max(1, math.ceil((until_s - from_s) / _STEP_S))
        t_s = [from_s + (until_s - from_s) * step / steps for step in range(steps + 1)]
        way_m = np.array([self._way_and_speed(t)[0] for t in t_s])
        return Trajectory(
            np.array(t_s), self._start_m + way_m[:, None] * self._heading, np.array([self.yaw_rad] * len(t_s))
        )

    def velocity(self, t_s: float) -> Vector3:
        east, north, _ = self._way_and_speed(t_s)[1] * self._heading
        return (float(east), float(north), 0.0)

    def _way_and_speed(self, t_s: float) -> tuple[float, float]:
        if self._go_s is None or t_s <= self._go_s:
            return 0.0, 0.0
        driven_s = t_s - self._go_s
        ramp_s = self._speed_m_s / _RAMP_M_S2
        if driven_s < ramp_s:
            return 0.5 * _RAMP_M_S2 * driven_s**2, _RAMP_M_S2 * driven_s
        return self._speed_m_s * (driven_s - 0.5 * ramp_s), self._speed_m_s
