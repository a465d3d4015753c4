"""The simulated world without sockets: true states of the vehicle in; CSI records, poses and the truth out. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from companion.pose import wire
from companion.sim import truth
from companion.sim.ax_radio import AxRadioLink
from companion.sim.radio import RadioLink
from companion.sim.scenario import RobotScenario, Scenario
from companion.sim.trajectory import BeaconDrive, Trajectory, VehicleTrack
from companion.sim.vio import Camera
from csi_bridge.feitcsi.records import FeitRecord
from csi_bridge.records import CsiRecord

_TRUTH_PERIOD_S: Final = 0.05
_HOLD_AFTER_S: Final = 0.25
"""The world waits this long for a late vehicle state; then the vehicle stands still where it was last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """What came into being in one step of the world, in the order of time."""

    csi_uav: list[CsiRecord] | list[FeitRecord]
    csi_uav_ns: list[int]
    """When each was received; all times are of the host's monotonic clock."""
    csi_beacon: list[CsiRecord] | list[FeitRecord]
    csi_beacon_ns: list[int]
    poses_uav: list[wire.RawPose]
    poses_beacon: list[wire.RawPose]
    world: truth.WorldTruth | None
    """At 20 Hz."""


class World:
    """The world without sockets: vehicle states in, samples of everything else out."""

    def __init__(self, scenario: Scenario, wall_minus_mono_ns: int) -> None:
        """`wall_minus_mono_ns`: wall clock minus monotonic clock of this host."""
        self._scenario = scenario
        self._wall_minus_mono_ns = wall_minus_mono_ns
        self._lag_ns = round(scenario.lag_s * 1e9)
        self._track = VehicleTrack()
        self._drive = BeaconDrive(scenario)
        self._camera_uav = _CameraRig(scenario, scenario.uav, 0)
        self._camera_beacon = _CameraRig(scenario, scenario.beacon, 1)
        self._levers_m = (np.array(scenario.uav.antennas_m[:1]), np.array(scenario.beacon.antennas_m[:1]))
        self._start_ns: int | None = None
        self._radio: RadioLink | AxRadioLink | None = None
        self._newest: truth.VehicleTruth | None = None
        self._until_s = 0.0
        self._next_truth_s = 0.0

    def hear(self, vehicle: truth.VehicleTruth) -> None:
        """Takes a true state of the vehicle; the first one starts the world's time."""
        if self._start_ns is None:
            self._start_ns = vehicle.t_mono_ns + self._lag_ns
            link = AxRadioLink if self._scenario.radio.card == "ax210" else RadioLink
            self._radio = link(self._scenario, self._start_ns + self._wall_minus_mono_ns)
        self._newest = vehicle
        self._track.append(self._seconds(vehicle.t_mono_ns + self._lag_ns), vehicle.p_enu_m, vehicle.yaw_enu_rad)

    def is_known(self, now_ns: int) -> bool:
        """Whether what happens until `now_ns` has been given out."""
        return self._start_ns is not None and self._seconds(now_ns) < self._until_s

    def advance(self, now_ns: int) -> Sample | None:
        """Lives on as far as the vehicle is known, which is the lag of the scenario ahead of its newest state, or until
        `now_ns` where it has fallen silent; None when there is nothing new."""
        if self._start_ns is None or self._radio is None or self._track.newest_s is None:
            return None
        from_s, until_s = self._until_s, self._horizon(self._seconds(now_ns), self._track.newest_s)
        if until_s <= from_s:
            return None
        self._until_s = until_s
        # Exchanges wait until their answer's time has come, so some of the slot before are made in this one.
        since_s = from_s - 2 / self._scenario.radio.exchange_rate_hz
        uav = self._track.trajectory(since_s, until_s)
        beacon = self._drive.trajectory(since_s, until_s)
        csi_uav, csi_beacon = self._radio.advance(until_s, uav, beacon)
        poses_uav = self._camera_uav.poses(until_s, uav, self._start_ns)
        poses_beacon = self._camera_beacon.poses(until_s, beacon, self._start_ns)
        uav_ns, beacon_ns = (
            (self._start_ns + np.rint(t_s * 1e9).astype(np.int64)).tolist() for t_s in self._radio.heard_s
        )
        return Sample(
            csi_uav=csi_uav,
            csi_uav_ns=uav_ns,
            csi_beacon=csi_beacon,
            csi_beacon_ns=beacon_ns,
            poses_uav=poses_uav,
            poses_beacon=poses_beacon,
            world=self._truth(until_s, uav, beacon),
        )

    def _seconds(self, t_mono_ns: int) -> float:
        assert self._start_ns is not None
        return (t_mono_ns - self._start_ns) * 1e-9

    def _horizon(self, now_s: float, newest_s: float) -> float:
        return newest_s if now_s - newest_s < _HOLD_AFTER_S else now_s

    def _truth(self, t_s: float, uav: Trajectory, beacon: Trajectory) -> truth.WorldTruth | None:
        """At 20 Hz; the beacon's drive is decided here as well."""
        if t_s < self._next_truth_s:
            return None
        assert self._start_ns is not None and self._newest is not None and self._radio is not None
        self._next_truth_s = max(self._next_truth_s + _TRUTH_PERIOD_S, t_s)
        at = np.array([t_s])
        ends = (r.antennas_at(at, levers)[0, 0] for r, levers in zip((uav, beacon), self._levers_m, strict=True))
        (ux, uy, uz), (bx, by, bz) = (end.tolist() for end in ends)
        distance_m = math.dist((ux, uy, uz), (bx, by, bz))
        self._drive.watch(t_s, distance_m, math.hypot(ux, uy))
        return truth.WorldTruth(
            t_mono_ns=self._start_ns + round(t_s * 1e9),
            vehicle=self._newest,
            uav_antenna_enu_m=(ux, uy, uz),
            beacon_antenna_enu_m=(bx, by, bz),
            beacon_v_enu_m_s=self._drive.velocity(t_s),
            distance_m=distance_m,
            exchanges=self._radio.exchanges,
        )


class _CameraRig:
    """A camera together with the times of its frames."""

    def __init__(self, scenario: Scenario, robot: RobotScenario, index: int) -> None:
        self._camera = Camera(scenario.vio, scenario.seed, index, robot.frame_yaw_rad)
        self._period_s = 1 / scenario.vio.rate_hz
        self._frame = 0

    def poses(self, until_s: float, robot: Trajectory, start_ns: int) -> list[wire.RawPose]:
        count = math.floor(until_s / self._period_s) + 1 - self._frame
        t_s = np.arange(self._frame, self._frame + count, dtype=np.float64) * self._period_s
        self._frame += count
        p_enu_m, yaw_rad = robot.at(t_s)
        return [
            self._camera.pose(start_ns + round(t * 1e9), (p[0], p[1], p[2]), yaw)
            for t, p, yaw in zip(t_s.tolist(), p_enu_m.tolist(), yaw_rad.tolist(), strict=True)
        ]
