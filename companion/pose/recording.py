"""A recorded trajectory as a live source, at the pace it was recorded: any format of docs/recordings.md, z up. One
without attitudes, as the motion capture of the WSR data sets, is played level, with the nose to the file's x."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

from companion.core.clock import NS_PER_S, Clock
from companion.core.messages import Pose, Quaternion, Vector3
from companion.errors import CompanionError
from companion.host.coalescing import Readers
from companion.pose.autopilot import turned
from companion.pose.port import PoseSink
from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file

_log = logging.getLogger(__name__)
_LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class _Row:
    t_s: float
    p_m: Vector3
    q_wxyz: Quaternion


class FilePoses:
    """Plays a file from its first pose, stamped from now on. Raises CompanionError naming the file and the line."""

    def __init__(self, path: Path, clock: Clock, on_pose: PoseSink) -> None:
        self._rows, self.has_attitudes = _read(path)
        self._clock = clock
        self._on_pose = on_pose
        self._north_rad = 0.0
        self.received = 0
        self.malformed = 0
        self.resets = 0

    def align(self, north_yaw_rad: float) -> None:
        self._north_rad = north_yaw_rad

    async def run(self, readers: Readers | None = None) -> None:
        """Until the end of the file."""
        start_ns, first_s = self._clock.now_ns(), self._rows[0].t_s
        before: _Row | None = None
        for row in self._rows:
            t_ns = start_ns + round((row.t_s - first_s) * NS_PER_S)
            await self._clock.sleep_until_ns(t_ns)
            pose = Pose(
                t_mono_ns=t_ns,
                p_enu_m=row.p_m,
                q_enu_from_body=row.q_wxyz,
                v_enu_m_s=_velocity(before, row),
                confidence=3,
            )
            self.received += 1
            self._on_pose(turned(pose, self._north_rad))
            before = row

    def close(self) -> None:
        """Nothing is open: the file was read as a whole."""


def _velocity(before: _Row | None, row: _Row) -> Vector3:
    if before is None or row.t_s <= before.t_s:
        return (0.0, 0.0, 0.0)
    x, y, z = ((p - q) / (row.t_s - before.t_s) for p, q in zip(row.p_m, before.p_m, strict=True))
    return (x, y, z)


def _read(path: Path) -> tuple[list[_Row], bool]:
    """The rows, and whether they have attitudes."""
    try:
        file = read_trajectory_file(path)
    except TrajectoryError as error:
        raise CompanionError(f"pose.recording {error}") from None
    for note in file.notes:
        _log.warning("pose.recording %s", note)
    turns = [_LEVEL] * len(file.t_s) if file.q_wxyz is None else [_quaternion(*q) for q in file.q_wxyz.tolist()]
    rows = zip(file.t_s.tolist(), file.p_m.tolist(), turns, strict=True)
    return [_Row(t_s, (x, y, z), q_wxyz) for t_s, (x, y, z), q_wxyz in rows], file.q_wxyz is not None


def _quaternion(w: float, x: float, y: float, z: float) -> Quaternion:
    return w, x, y, z
