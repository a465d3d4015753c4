"""Recorded trajectories as an analysis takes them: whose they are, in the truth's axes, on the packets' clock."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
import numpy.typing as npt

from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file
from wsr.geometry import quaternion_from_yaw, quaternion_multiply, rotation_z, yaw_of

Array = npt.NDArray[np.float64]

_MAX_STEP_M = 0.1
_MAX_STEP_S = 0.1


class PoseKind(StrEnum):
    """Who tracked the robot."""

    MOCAP = "mocap"
    T265 = "t265"
    ODOM = "odom"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordedTrajectory:
    """Positions over time in axes that agree with the truth's: x, y, z taken as East, North, Up.

    Only differences of positions are used, except in motion capture, whose origin is the truth's too.
    """

    path: Path
    kind: PoseKind
    t_s: Array
    """(N,) on the clock of the host that recorded the packets."""
    p_enu_m: Array
    """(N, 3)."""
    q_wxyz: Array | None
    """(N, 4) where the file has attitudes."""
    problems: tuple[str, ...] = ()
    """What is wrong with the file, though it can be used."""
    layout: str = ""
    """What the file was taken for, in words."""

    @property
    def origin_is_true(self) -> bool:
        """Whether positions, not only their differences, are in the frame of the true positions."""
        return self.kind is PoseKind.MOCAP


def read_trajectory(path: Path, kind: PoseKind, offset_s: float = 0.0, may_stand: bool = False) -> RecordedTrajectory:
    """Any format of docs/recordings.md; `offset_s` is added to its stamps. Raises TrajectoryError, also where the robot
    never moves, unless it `may_stand`.

    Motion capture is the frame of the truth. T265 files are z-up and start with yaw 0, as the robot does, so they are
    used as they are. Odometry starts with any yaw, which its first quaternion tells: it is turned back by that.
    """
    file = read_trajectory_file(path)
    t_s = file.t_s + offset_s if offset_s else file.t_s
    p_m, q_wxyz, problems = file.p_m, file.q_wxyz, list(file.notes)
    if kind is PoseKind.ODOM:
        if q_wxyz is None:
            raise TrajectoryError(f"{path}: odometry without attitude; expected qx, qy, qz, qw too")
        start_yaw_rad = float(yaw_of(q_wxyz[0]))
        p_m = p_m @ rotation_z(-start_yaw_rad).T
        q_wxyz = quaternion_multiply(quaternion_from_yaw(-start_yaw_rad), q_wxyz)
    if not may_stand and not np.any(np.linalg.norm(p_m - p_m[0], axis=1) > 1e-6):
        raise TrajectoryError(f"{path}: the position never changes; there is no aperture without motion")
    jumps = _jumps(t_s, p_m)
    if jumps:
        problems.append(f"{path}: {jumps} jumps of more than 0.1 m; the tracker lost itself")
    return RecordedTrajectory(
        path=path, kind=kind, t_s=t_s, p_enu_m=p_m, q_wxyz=q_wxyz, problems=tuple(problems), layout=file.layout
    )


def guess_kind(path: Path) -> PoseKind:
    """The kind that a file name of the WSR data sets stands for; motion capture where it says nothing."""
    for kind in (PoseKind.T265, PoseKind.ODOM):
        if path.name.lower().startswith(kind.value):
            return kind
    return PoseKind.MOCAP


def _jumps(t_s: Array, p_m: Array) -> int:
    steps_m = np.linalg.norm(np.diff(p_m, axis=0), axis=1)
    return int(np.count_nonzero((steps_m > _MAX_STEP_M) & (np.diff(t_s) < _MAX_STEP_S)))
