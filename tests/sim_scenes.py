"""Scenes for tests of the simulator: scenarios and trajectories with known truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from companion.sim.scenario import CsiEndpoint, RadioScenario, RobotScenario, Scenario, VioScenario
from companion.sim.trajectory import Array, Trajectory

UAV_MAC = "00:21:6A:00:00:01"
BEACON_MAC = "00:21:6A:00:00:02"
CLEAN_RADIO = RadioScenario(
    reflectors=(), loss_probability=0.0, turnaround_jitter_s=0.0, turnaround_outlier_probability=0.0
)
STEADY_VIO = VioScenario(
    scale_std=0.0,
    bias_std=0.0,
    walk_m_sqrt_s=0.0,
    north_std_rad=0.0,
    yaw_rate_std_rad_s=0.0,
    yaw_walk_rad_sqrt_s=0.0,
    jitter_m=0.0,
)


def scene(
    seed: int = 1,
    radio: RadioScenario | None = None,
    folder: Path = Path("unused"),
    connectors: Sequence[int] = (),
    uav_ppm: float = 1.5,
    beacon_ppm: float = -0.5,
    beacon_clock_offset_s: float = 38.0,
) -> Scenario:
    """A scenario with sockets in `folder`; its CSI comes by the two `connectors` if any are given."""

    def robot(name: str, mac: str, height_m: float, ppm: float, *, offset_s: float) -> RobotScenario:
        endpoint = (
            CsiEndpoint("unix", path=str(folder / f"{name}-csi.sock"))
            if not connectors
            else CsiEndpoint("netlink", connector_idx=connectors[name == "beacon"])
        )
        return RobotScenario(
            mac=mac,
            csi=endpoint,
            pose_socket=str(folder / f"{name}-pose.sock"),
            antennas_m=((0.02, 0.05, height_m), (0.02, 0.0, height_m), (0.02, -0.05, height_m)),
            oscillator_ppm=ppm,
            clock_offset_s=offset_s,
        )

    return Scenario(
        seed=seed,
        uav=robot("uav", UAV_MAC, 0.1, uav_ppm, offset_s=0.0),
        beacon=robot("beacon", BEACON_MAC, 0.5, beacon_ppm, offset_s=beacon_clock_offset_s),
        truth_in=str(folder / "truth-in.sock"),
        truth_out=str(folder / "truth-out.sock"),
        radio=radio or RadioScenario(),
    )


def weave(heading_rad: float, length_m: float = 1.2, speed_m_s: float = 0.4, start_s: float = 1.0) -> Trajectory:
    """A leg of `length_m` along `heading_rad` that weaves sideways and vertically, turning its nose meanwhile."""
    share = np.linspace(0.0, 1.0, 400)
    ahead = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])
    left = np.array([-math.sin(heading_rad), math.cos(heading_rad), 0.0])
    p_enu_m = (
        np.outer(length_m * share, ahead)
        + np.outer(0.18 * np.sin(math.tau * share), left)
        + np.outer(1.5 + 0.12 * np.cos(math.tau * share), [0.0, 0.0, 1.0])
    )
    return Trajectory(start_s + share * length_m / speed_m_s, p_enu_m, heading_rad + 0.5 * share)


def straight(
    p_from_enu_m: Array, velocity_m_s: Array, start_s: float, duration_s: float, *, yaw_rad: float
) -> Trajectory:
    """Constant velocity; zero stands still."""
    t_s = np.array([start_s, start_s + duration_s])
    return Trajectory(t_s, p_from_enu_m + np.outer(t_s - start_s, velocity_m_s), np.full(2, yaw_rad))
