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
    """The ground robot: stands still, then drives with a short ramp of its speed, straight on or round a closed course
    of two straights and two half circles to the left."""

    def __init__(self, scenario: Scenario) -> None:
        drawn = np.random.default_rng([scenario.seed, _BEACON_STREAM]).uniform(-math.pi, math.pi, 2)
        given = (scenario.beacon_azimuth_rad, scenario.drive_azimuth_rad)
        azimuth_rad, self.yaw_rad = (float(d) if g is None else g for g, d in zip(given, drawn, strict=True))
        distance_m = scenario.start_distance_m
        east_m, north_m = distance_m * math.cos(azimuth_rad), distance_m * math.sin(azimuth_rad)
        self._start_m = np.array([east_m, north_m, scenario.beacon_floor_m])
        self._speed_m_s = scenario.drive_speed_m_s
        self._go_below_m = scenario.start_distance_m * scenario.drive_below_share
        self._go_after_m = scenario.drive_after_m
        self._straight_m, self._radius_m = scenario.drive_straight_m, scenario.drive_turn_radius_m
        self._go_s: float | None = None

    def watch(self, t_s: float, distance_m: float, flown_m: float = 0.0) -> None:
        """Starts the drive at t_s once the distance is below its share, or, where the scenario says so, the vehicle is
        `flown_m` across the ground from its start; later calls change nothing."""
        goes = distance_m < self._go_below_m if self._go_after_m is None else flown_m > self._go_after_m
        if self._go_s is None and goes:
            self._go_s = t_s

    def trajectory(self, from_s: float, until_s: float) -> Trajectory:
        """Samples at most 10 ms apart that cover [from_s, until_s]."""
        steps = max(1, math.ceil((until_s - from_s) / _STEP_S))
        t_s = from_s + (until_s - from_s) * np.arange(steps + 1) / steps
        if self._stands:
            return Trajectory(t_s, np.repeat(self._start_m[None], steps + 1, axis=0), np.full(steps + 1, self.yaw_rad))
        return Trajectory(t_s, *self._course(self._way_and_speed(t_s)[0]))

    def place(self, t_s: float) -> Vector3:
        """Where it is at t_s."""
        x, y, z = (self._start_m if self._stands else self.trajectory(t_s, t_s).p_enu_m[0]).tolist()
        return x, y, z

    @property
    def _stands(self) -> bool:
        return self._go_s is None or not self._speed_m_s

    def velocity(self, t_s: float) -> Vector3:
        if self._stands:
            return (0.0, 0.0, 0.0)
        way_m, speed_m_s = self._way_and_speed(np.array([t_s]))
        yaw_rad, speed = float(self._course(way_m)[1][0]), float(speed_m_s[0])
        return (speed * math.cos(yaw_rad), speed * math.sin(yaw_rad), 0.0)

    def places_m(self) -> Array:
        """Corners (K, 3) of where it ever is: of the start alone where the drive has no end."""
        if self._straight_m is None or not self._speed_m_s:
            return self._start_m[None]
        radius_m = self._radius_m
        ahead, left = np.meshgrid([-radius_m, self._straight_m + radius_m], [0.0, 2 * radius_m])
        return self._placed(ahead.ravel(), left.ravel())

    def _course(self, way_m: Array) -> tuple[Array, Array]:
        """Places (N, 3) and headings (N,) after ways (N,)."""
        if self._straight_m is None:
            return self._placed(way_m, np.zeros_like(way_m)), np.full(len(way_m), self.yaw_rad)
        straight_m, radius_m = self._straight_m, self._radius_m
        half_m = straight_m + math.pi * radius_m
        halves, rest_m = np.divmod(way_m, half_m)
        turned = np.maximum(rest_m - straight_m, 0.0) / radius_m
        ahead = np.minimum(rest_m, straight_m) + radius_m * np.sin(turned)
        left = radius_m * (1 - np.cos(turned))
        back = halves % 2 == 1
        places_m = self._placed(np.where(back, straight_m - ahead, ahead), np.where(back, 2 * radius_m - left, left))
        return places_m, self.yaw_rad + math.pi * halves + turned

    def _placed(self, ahead_m: Array, left_m: Array) -> Array:
        """Places (N, 3), so far ahead and to the left of the start."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        across_m = [cos * ahead_m - sin * left_m, sin * ahead_m + cos * left_m, np.zeros_like(ahead_m)]
        return self._start_m + np.stack(across_m, axis=1)

    def _way_and_speed(self, t_s: Array) -> tuple[Array, Array]:
        """Ways driven (N,) and speeds (N,) at t_s (N,)."""
        if self._go_s is None or not self._speed_m_s:
            return np.zeros_like(t_s), np.zeros_like(t_s)
        driven_s = np.maximum(t_s - self._go_s, 0.0)
        ramp_s = np.minimum(driven_s, self._speed_m_s / _RAMP_M_S2)
        speed_m_s = _RAMP_M_S2 * ramp_s
        return 0.5 * speed_m_s * ramp_s + speed_m_s * (driven_s - ramp_s), speed_m_s
