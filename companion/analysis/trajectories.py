"""Recorded trajectories of the receiving robot: motion capture, T265 and wheel odometry, as CSV."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError
from wsr.geometry import quaternion_from_yaw, quaternion_multiply, rotation_z, yaw_of

Array = npt.NDArray[np.float64]

MAX_POSITION_M: Final = 1e5
"""No building is that large: a number beyond is no place."""
_POSITION_COLUMNS = 5
_ATTITUDE_COLUMNS = 9
_MAX_STEP_M = 0.1
_MAX_STEP_S = 0.1
_MAX_STEPPED_BACK = 0.1


class PoseKind(StrEnum):
    """Who tracked the robot."""

    MOCAP = "mocap"
    T265 = "t265"
    ODOM = "odom"


class TrajectoryError(CompanionError):
    """A trajectory file cannot be used; the message names the file and the line."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTrajectory:
    """Positions over time in axes that agree with the truth's: x, y, z taken as East, North, Up.

    Only differences of positions are used, except in motion capture, whose origin is the truth's too.
    """

    path: Path
    kind: PoseKind
    t_s: Array
    """(N,) wall time of the receiver's host."""
    p_enu_m: Array
    """(N, 3)."""
    q_wxyz: Array | None
    """(N, 4) where the file has attitudes."""
    problems: tuple[str, ...] = ()
    """What is wrong with the file, though it can be used."""

    @property
    def origin_is_true(self) -> bool:
        """Whether positions, not only their differences, are in the frame of the true positions."""
        return self.kind is PoseKind.MOCAP


def read_trajectory(path: Path, kind: PoseKind) -> RecordedTrajectory:
    """Rows of `sec, nsec, x, y, z[, qx, qy, qz, qw, ...]`, where sec may be fractional. Raises TrajectoryError.

    A line of headings, comments (#) and a byte order mark are passed over, and so is a last line that is cut off.
    Motion capture is the frame of the truth. T265 files are z-up and start with yaw 0, as the robot does, so they are
    used as they are. Odometry starts with any yaw, which its first quaternion tells: it is turned back by that.
    """
    rows, problems = _rows(path)
    t_s = rows[:, 0] + rows[:, 1] * 1e-9
    p_m, q_wxyz = rows[:, 2:5], _attitudes(rows)
    if kind is PoseKind.ODOM:
        if q_wxyz is None:
            raise TrajectoryError(f"{path}: odometry without attitude, expected {_ATTITUDE_COLUMNS} columns")
        start_yaw_rad = float(yaw_of(q_wxyz[0]))
        p_m = p_m @ rotation_z(-start_yaw_rad).T
        q_wxyz = quaternion_multiply(quaternion_from_yaw(-start_yaw_rad), q_wxyz)
    if not np.any(np.linalg.norm(p_m - p_m[0], axis=1) > 1e-6):
        raise TrajectoryError(f"{path}: the position never changes; there is no aperture without motion")
    jumps = _jumps(t_s, p_m)
    if jumps:
        problems.append(f"{path}: {jumps} jumps of more than 0.1 m; the tracker lost itself")
    return RecordedTrajectory(path, kind, t_s, p_m, q_wxyz, tuple(problems))


def guess_kind(path: Path) -> PoseKind:
    """The kind that a file name of the WSR data sets stands for; motion capture where it says nothing."""
    for kind in (PoseKind.T265, PoseKind.ODOM):
        if path.name.lower().startswith(kind.value):
            return kind
    return PoseKind.MOCAP


def _rows(path: Path) -> tuple[Array, list[str]]:
    """Finite rows by time, and what is wrong with the file."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: not a text file, expected CSV rows of sec, nsec, x, y, z") from None
    rows, problems = _parsed(path, text)
    if len(rows) < 2:
        raise TrajectoryError(f"{path}: {'empty file' if not rows else 'only one row'}, expected a trajectory")
    width = min(map(len, rows))
    table = np.array([row[: min(width, _ATTITUDE_COLUMNS)] for row in rows])
    finite = table[np.isfinite(table).all(axis=1)]
    if len(finite) < 2:
        raise TrajectoryError(f"{path}: no finite poses in {len(rows)} rows")
    late = _stepped_back(finite[:, 0] + finite[:, 1] * 1e-9)
    if np.any(late):
        problems.append(f"{path}: {int(late.sum())} poses left out, whose clock stepped back over earlier ones")
        finite = finite[~late]
    return np.asarray(finite[np.argsort(finite[:, 0] + finite[:, 1] * 1e-9, kind="stable")]), problems


def _parsed(path: Path, text: str) -> tuple[list[list[float]], list[str]]:
    problems = []
    lines = text.splitlines()
    if lines and lines[-1].strip() and not text.endswith("\n"):
        # A logger that was stopped in the middle of a number leaves one that looks complete.
        lines.pop()
        problems.append(f"{path}: its last line, {len(lines) + 1}, is cut off (no line end) and not used")
    numbered = [(number, line) for number, line in enumerate(lines, start=1) if _is_content(line)]
    if numbered and not any(map(_is_number, numbered[0][1].split(","))):
        del numbered[0]  # headings
    return [_row(path, number, line) for number, line in numbered], problems


def _is_content(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _row(path: Path, number: int, line: str) -> list[float]:
    fields = [field.strip() for field in line.split(",")]
    while fields and not fields[-1]:
        fields.pop()
    if "" in fields:
        raise TrajectoryError(f"{path}: line {number} has nothing in column {fields.index('') + 1}")
    try:
        values = [float(field) for field in fields]
    except ValueError:
        raise TrajectoryError(f"{path}: line {number} is no row of numbers: {line.strip()[:60]!r}") from None
    if len(values) < _POSITION_COLUMNS:
        raise TrajectoryError(f"{path}: line {number} has {len(values)} columns, expected sec, nsec, x, y, z")
    if any(MAX_POSITION_M < abs(value) < math.inf for value in values[2:5]):
        raise TrajectoryError(f"{path}: line {number} is {max(map(abs, values[2:5])):.3g} m away; expected below 1e5 m")
    return values


def _attitudes(rows: Array) -> Array | None:
    if rows.shape[1] < _ATTITUDE_COLUMNS:
        return None
    q_wxyz = rows[:, [8, 5, 6, 7]]
    norm = np.linalg.norm(q_wxyz, axis=1, keepdims=True)
    return np.asarray(q_wxyz / norm) if np.all(np.abs(norm - 1) < 0.1) else None


def _stepped_back(t_s: Array) -> npt.NDArray[np.bool_]:
    """Which rows (N,) are stamped before an earlier one, if they are few: there the logger's clock stepped back, and
    sorted by time they would stand between poses that they do not belong to. Many such rows are a file out of order.
    """
    late = np.zeros(t_s.size, np.bool_)
    late[1:] = t_s[1:] < np.maximum.accumulate(t_s)[:-1]
    return late if late.mean() <= _MAX_STEPPED_BACK else np.zeros(t_s.size, np.bool_)


def _jumps(t_s: Array, p_m: Array) -> int:
    steps_m = np.linalg.norm(np.diff(p_m, axis=0), axis=1)
    return int(np.count_nonzero((steps_m > _MAX_STEP_M) & (np.diff(t_s) < _MAX_STEP_S)))
