"""A recorded trajectory as a live source, at the pace it was recorded: TUM (`t x y z qx qy qz qw`, blanks) or the WSR
data sets' CSV (`sec, nsec, x, y, z, qx, qy, qz, qw`), both z-up."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.clock import NS_PER_S, Clock
from companion.errors import CompanionError
from companion.messages import Pose, Quaternion, Vector3
from companion.pose.autopilot import turned
from companion.pose.port import PoseSink

_TUM_COLUMNS = 8
_CSV_COLUMNS = 9


@dataclass(frozen=True, slots=True)
class _Row:
    t_s: float
    p_m: Vector3
    q_wxyz: Quaternion


class RecordedPoses:
    """Plays a file from its first pose, stamped from now on. Raises CompanionError naming the file and the line."""

    def __init__(self, path: Path, clock: Clock, on_pose: PoseSink) -> None:
        self._rows = _read(path)
        self._clock = clock
        self._on_pose = on_pose
        self._north_rad = 0.0
        self.received = 0
        self.malformed = 0
        self.resets = 0

    def align(self, north_yaw_rad: float) -> None:
        self._north_rad = north_yaw_rad

    async def run(self) -> None:
        """Until the end of the file."""
        start_ns, first_s = self._clock.now_ns(), self._rows[0].t_s
        before: _Row | None = None
        for row in self._rows:
            t_ns = start_ns + round((row.t_s - first_s) * NS_PER_S)
            await self._clock.sleep_until_ns(t_ns)
            pose = Pose(t_ns, row.p_m, row.q_wxyz, _velocity(before, row), 3)
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


def _read(path: Path) -> list[_Row]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise CompanionError(f"pose.recording {path}: cannot be read: {error}") from None
    rows = list(_parsed(path, text))
    if len(rows) < 2:
        raise CompanionError(f"pose.recording {path}: {len(rows)} poses, expected a trajectory")
    for number, (a, b) in enumerate(itertools.pairwise(rows), start=2):
        if b.t_s < a.t_s:
            raise CompanionError(f"pose.recording {path}: pose {number} is older than the one before it")
    return rows


def _parsed(path: Path, text: str) -> Iterator[_Row]:
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("#") or (number == 1 and line[0].isalpha()):
            continue  # comments and headings
        fields = line.split(",") if "," in line else line.split()
        wanted = _CSV_COLUMNS if "," in line else _TUM_COLUMNS
        try:
            values = [float(field) for field in fields if field.strip()]
            if len(values) < wanted or not all(map(math.isfinite, values[:wanted])):
                raise ValueError
        except ValueError:
            raise CompanionError(
                f"pose.recording {path}: line {number}: expected {wanted} finite numbers, got {line[:60]!r}"
            ) from None
        yield _row(values, is_csv="," in line)


def _row(values: list[float], is_csv: bool) -> _Row:
    t_s = values[0] + values[1] * 1e-9 if is_csv else values[0]
    x, y, z, qx, qy, qz, qw = values[2:9] if is_csv else values[1:8]
    return _Row(t_s, (x, y, z), (qw, qx, qy, qz))
