"""A recorded trajectory as a live source, at the pace it was recorded: TUM (`t x y z qx qy qz qw`, blanks) or the WSR
data sets' CSV (`sec, nsec, x, y, z[, qx, qy, qz, qw]`), both z-up. Their motion capture has no attitudes: it is played
level, with the nose to the file's x."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.core.clock import NS_PER_S, Clock
from companion.core.messages import Pose, Quaternion, Vector3
from companion.errors import CompanionError
from companion.pose.autopilot import turned
from companion.pose.port import PoseSink

_log = logging.getLogger(__name__)
_MAX_OLDER = 0.1
"""Share of poses whose clock may have stepped back, as it did in some of the data sets: those are left out."""
_TUM_COLUMNS = 8
_CSV_COLUMNS = 9
_CSV_PLACE_COLUMNS = 5
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


def _read(path: Path) -> tuple[list[_Row], bool]:
    """The rows, and whether they have attitudes."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise CompanionError(f"pose.recording {path}: cannot be read: {error}") from None
    table = list(_parsed(path, text))
    if len(table) < 2:
        raise CompanionError(f"pose.recording {path}: {len(table)} poses, expected a trajectory")
    rows, older = [_row(table[0])], list[int]()
    for number, row in enumerate(map(_row, table[1:]), start=2):
        if row.t_s < rows[-1].t_s:
            older.append(number)
        else:
            rows.append(row)
    if len(older) > _MAX_OLDER * len(table):
        raise CompanionError(
            f"pose.recording {path}: pose {older[0]} is older than the one before it, and so are {len(older)} of "
            f"{len(table)}; expected them in order of time"
        )
    if older:
        _log.warning("pose.recording %s: %d poses left out, whose clock stepped back", path, len(older))
    return rows, len(table[0]) != _CSV_PLACE_COLUMNS


def _parsed(path: Path, text: str) -> Iterator[list[float]]:
    """The numbers of each row, all of one width: TUM's, or the CSV's with or without attitudes."""
    wanted = 0
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("#") or (number == 1 and line[0].isalpha()):
            continue  # comments and headings
        is_csv = "," in line
        fields = [field for field in (line.split(",") if is_csv else line.split()) if field.strip()]
        if not wanted:
            is_place = is_csv and len(fields) == _CSV_PLACE_COLUMNS
            wanted = (_CSV_PLACE_COLUMNS if is_place else _CSV_COLUMNS) if is_csv else _TUM_COLUMNS
        try:
            values = [float(field) for field in fields][:wanted]
            if len(values) < wanted or not all(map(math.isfinite, values)):
                raise ValueError
        except ValueError:
            raise CompanionError(
                f"pose.recording {path}: line {number}: expected {wanted} finite numbers, got {line[:60]!r}"
            ) from None
        yield values


def _row(values: list[float]) -> _Row:
    if len(values) == _TUM_COLUMNS:
        t_s, x, y, z, *attitude = values
    else:
        seconds, nanoseconds, x, y, z, *attitude = values
        t_s = seconds + nanoseconds * 1e-9
    if not attitude:
        return _Row(t_s, (x, y, z), _LEVEL)
    qx, qy, qz, qw = attitude
    return _Row(t_s, (x, y, z), (qw, qx, qy, qz))
