"""The one reader of trajectory files, for flight (`pose.source: recording`) and analysis alike (docs/recordings.md)."""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.pose.motive import LAYOUT, Row, is_motive, motive_rows
from companion.pose.trajectory_bag import is_bag, read_bag
from companion.pose.trajectory_checks import check_places, check_quaternions, check_speed, check_stamps, in_order
from companion.pose.trajectory_columns import (
    EXPECTED,
    Columns,
    TrajectoryError,
    are_headings,
    columns_by_headings,
    columns_by_layout,
)
from companion.pose.trajectory_rows import check_no_halves, check_no_units, check_one_body, check_rows_once
from csi_bridge.foreign import TEXT, foreign_format
from csi_bridge.regular_file import open_regular

Array = npt.NDArray[np.float64]
Numbered = tuple[int, list[float]]
"""Line number and t, x, y, z[, qx, qy, qz, qw]."""

_NS: Final = 1_000_000_000
_MAX_BYTES: Final = 1 << 30
_MAX_ANGLE_RAD: Final = 2 * math.pi + 0.01
_EXPECTED_TEXT: Final = f"expected rows of a trajectory as text; {EXPECTED}"
_FIRST_BYTES: Final = 4096
_COMMENT: Final = re.compile(r"\s*(?:#|//)")
_PERCENT: Final = re.compile(r"^\s*%\s+")
_EXCEL: Final = re.compile(r"\"?sep=.\"?")
"""A first line that tells Excel what separates, as the next one shows too."""
_DECIMAL_COMMA: Final = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrajectoryFile:
    """Finite poses in order of time, N of them and two at least."""

    path: Path
    layout: str
    """What the file was taken for, in words."""
    t_s: Array
    """(N,) as the file stamps them."""
    p_m: Array
    """(N, 3) in the file's own axes, z up."""
    q_wxyz: Array | None
    """(N, 4) unit quaternions, file's axes from body, where the file has attitudes."""
    notes: tuple[str, ...] = ()
    """What was left out or assumed."""


def read_trajectory_file(path: Path) -> TrajectoryFile:
    """Any of the documented formats. Raises TrajectoryError naming the file, the line and what is expected."""
    notes: list[str] = []
    if is_bag(path):
        return _trajectory(path, *read_bag(path, notes), notes)
    lines = _lines(path, notes)
    rows = _rows(str(path), lines)
    if not rows:
        what = "not one whole line" if notes else "empty file"
        raise TrajectoryError(f"{path}: {what}, expected a trajectory")
    if is_motive(rows):
        layout = LAYOUT
        found, unseen = motive_rows(str(path), rows)
        if unseen:
            notes.append(f"{path}: {unseen} frames without a pose: the body was not seen")
    else:
        layout, found = _table(path, lines, rows, notes)
    return _trajectory(path, layout, found, notes)


def _trajectory(path: Path, layout: str, found: Sequence[Numbered], notes: list[str]) -> TrajectoryFile:
    if len(found) < 2:
        raise TrajectoryError(f"{path}: {'no' if not found else 'only one'} pose, expected a trajectory")
    table = np.array([values for _, values in found])
    lines = np.array([number for number, _ in found], np.int64)
    finite = np.isfinite(table).all(axis=1)
    if np.count_nonzero(finite) < 2:
        raise TrajectoryError(f"{path}: no finite poses in {len(found)} rows")
    if not np.all(finite):
        notes.append(f"{path}: {int((~finite).sum())} poses left out that are no numbers (nan or inf)")
    table, lines, name = table[finite], lines[finite], str(path)
    check_places(name, lines, table[:, 1:4])
    kept = in_order(name, lines, table[:, 0], notes)
    table, lines = table[kept], lines[kept]
    if len(table) < 2:
        raise TrajectoryError(f"{path}: only one pose, expected a trajectory")
    check_stamps(name, lines, table[:, 0])
    check_speed(name, lines, table[:, 0], table[:, 1:4])
    q_wxyz = None if table.shape[1] == 4 else check_quaternions(name, lines, table[:, [7, 4, 5, 6]])
    return TrajectoryFile(
        path=path, layout=layout, t_s=table[:, 0], p_m=table[:, 1:4], q_wxyz=q_wxyz, notes=tuple(notes)
    )


def _lines(path: Path, notes: list[str]) -> list[str]:
    """Raises TrajectoryError for what is no text. A last line without its end is left out: a logger that was stopped in
    the middle of a number leaves one that looks complete."""
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size > _MAX_BYTES:
                raise TrajectoryError(f"{path}: more than 1 GiB, expected a trajectory")
            data = file.read()
    except OSError as error:
        raise TrajectoryError(f"{path}: {error.strerror}") from None
    what = foreign_format(data[:_FIRST_BYTES])
    if what not in ("", TEXT):
        raise TrajectoryError(f"{path}: {what}; {_EXPECTED_TEXT}")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise TrajectoryError(f"{path}: UTF-16 text; save it as UTF-8")
    data = data.rstrip(b"\0")  # as a file system leaves them behind what was not yet written
    if b"\0" in data:
        line = data[: data.index(b"\0")].count(b"\n") + 1
        raise TrajectoryError(f"{path}: not a text file in UTF-8: line {line} holds zero bytes; {_EXPECTED_TEXT}")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: not a text file in UTF-8; {_EXPECTED_TEXT}") from None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines[-1].strip():
        notes.append(f"{path}: its last line, {len(lines)}, is cut off (no line end) and not used")
    return lines[:-1]


def _rows(path: str, lines: Sequence[str]) -> list[Row]:
    """What is neither blank nor a comment, in fields. Raises TrajectoryError."""
    content = [(n, line) for n, line in enumerate(lines, start=1) if line.strip() and not _COMMENT.match(line)]
    if content and _EXCEL.fullmatch(content[0][1].strip()):
        del content[0]
    if content:  # MATLAB's mark before headings; `%time` of ROS is a name
        content[0] = content[0][0], _PERCENT.sub("", content[0][1])
    separator = _separator(content[0][1]) if content else None
    rows = []
    for number, line in content:
        try:
            rows.append((number, _fields(line, separator)))
        except csv.Error as error:
            raise TrajectoryError(f"{path}: line {number} is no row of a table: {error}") from None
    return rows


def _separator(line: str) -> str | None:
    """None for blanks of any kind; a tab where headings have blanks of their own (`time [s]`)."""
    if len(words := line.split()) > 1 and _has_decimal_commas(words):
        return None
    marks = ";," if all(map(_is_number, words)) else ";,\t"
    return next((mark for mark in marks if mark in line), None)


def _fields(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    if separator == "\t":
        return line.split(separator) if "\t" in line else line.split()
    if '"' in line:
        return next(csv.reader([line], delimiter=separator))
    return line.split(separator)


def _table(path: Path, lines: Sequence[str], rows: list[Row], notes: list[str]) -> tuple[str, list[Numbered]]:
    name, (line, first) = str(path), rows[0]
    separator, width = _separator(lines[line - 1]), len(_stripped(first))
    if _has_decimal_commas(first[:width]):
        raise TrajectoryError(f"{name}: line {line} has decimal commas; expected decimal points")
    if not any(map(_is_number, first)):
        columns, rows = columns_by_headings(name, _stripped(first)), rows[1:]
        check_no_units(name, rows)
        if separator is None:  # a blank within a heading shifts all that follow
            columns = replace(columns, exact=True)
    elif (headings := _commented(lines[: line - 1], separator, width)) is not None:
        columns = columns_by_headings(name, headings)
    else:
        _check_whole(f"{name}: line {line}", first[:width])
        check_no_halves(name, rows)
        columns = columns_by_layout(name, line, width, separator)
    check_one_body(name, columns.names, rows)
    check_rows_once(name, rows)
    found = list(_values(name, columns, rows))
    if columns.other_time is not None and not any(values[0] for _, values in found):
        columns = _by_other_time(name, columns)
        found = list(_values(name, columns, rows))
    notes += columns.notes
    return columns.layout, found


def _commented(above: Sequence[str], separator: str | None, width: int) -> list[str] | None:
    """Headings in a comment above the rows: as many words as these have fields, a time and a place among them."""
    for line in reversed([line.lstrip() for line in above if _COMMENT.match(line)]):
        texts = _stripped(_fields(line.lstrip("#/").strip(), separator))
        if len(texts) == width and are_headings(texts):
            return texts
    return None


def _stripped(fields: list[str]) -> list[str]:
    """Without empty fields at the end, as trailing commas leave them."""
    count = len(fields)
    while count and not fields[count - 1].strip():
        count -= 1
    return fields[:count]


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _has_decimal_commas(fields: Sequence[str]) -> bool:
    """Whether they are numbers, some of them with one: whole ones have none."""
    commas = [_DECIMAL_COMMA.fullmatch(field.strip()) is not None for field in fields]
    return any(commas) and all(is_one or _is_number(field) for is_one, field in zip(commas, fields, strict=True))


def _by_other_time(path: str, columns: Columns) -> Columns:
    assert columns.other_time is not None
    time, scale = columns.other_time
    note = f"{path}: stamps are those of {columns.names[time]}: the messages' own are all 0"
    return replace(columns, time=time, time_scale=scale, nsec=None, other_time=None, notes=(note,))


def _values(path: str, columns: Columns, rows: Sequence[Row]) -> Iterator[Numbered]:
    for number, fields in rows:
        fields = _stripped(fields)
        where = f"{path}: line {number}"
        if len(fields) > columns.width or (columns.exact and len(fields) < columns.width):
            why = "cut off" if len(fields) < columns.width else "a decimal comma"
            raise TrajectoryError(f"{where} has {len(fields)} columns, expected {columns.width} as above; {why}?")
        if columns.exact:
            _check_whole(where, fields)
        turn: list[float] = []
        stamp = _stamp(where, columns, fields)
        place = [_number(where, columns, fields, at) * columns.place_scale for at in columns.place]
        if columns.attitude is not None:
            turn = [_number(where, columns, fields, at) for at in columns.attitude]
        elif columns.angles is not None:
            turn = _from_angles(where, columns, fields)
        yield number, [stamp, *place, *turn]


def _check_whole(where: str, fields: Sequence[str]) -> None:
    for column, field in enumerate(fields, start=1):
        if not field.strip():
            raise TrajectoryError(f"{where} has nothing in column {column}")


def _stamp(where: str, columns: Columns, fields: Sequence[str]) -> float:
    first = _number(where, columns, fields, columns.time)
    if columns.nsec is None:
        return first * columns.time_scale
    nsec = _number(where, columns, fields, columns.nsec)
    if not (math.isfinite(nsec) and math.isfinite(first)):
        return math.nan
    told = "; expected sec, nsec, x, y, z, ...: in any other order give the file headings"
    if not nsec.is_integer() or not 0 <= nsec < _NS:
        raise TrajectoryError(f"{where}: nsec is {nsec:g}, not a whole number of 0..999999999{told}")
    # The data sets' motion capture has fractional seconds, and 0 beside them.
    if nsec and not first.is_integer():
        raise TrajectoryError(f"{where}: sec is {first!r}, not whole, though nsec is {nsec:g}{told}")
    return first + nsec * 1e-9


def _number(where: str, columns: Columns, fields: Sequence[str], at: int) -> float:
    text = fields[at].strip() if at < len(fields) else ""
    name = columns.names[at]
    if not text:
        raise TrajectoryError(f"{where} has nothing in column {at + 1} ({name})")
    try:
        return float(text)
    except ValueError:
        comma = "; expected a decimal point" if _DECIMAL_COMMA.fullmatch(text) else ""
        date = "; expected seconds, no date or time of day" if at == columns.time and ":" in text else ""
        raise TrajectoryError(f"{where} is no row of numbers: {name} is {text[:40]!r}{comma}{date}") from None


def _from_angles(where: str, columns: Columns, fields: Sequence[str]) -> list[float]:
    """qx, qy, qz, qw of Rz(yaw) Ry(pitch) Rx(roll)."""
    assert columns.angles is not None
    roll, pitch, yaw = (
        0.0 if at is None else _number(where, columns, fields, at) * columns.angle_scale for at in columns.angles
    )
    largest = max(abs(roll), abs(pitch), abs(yaw))
    if largest > _MAX_ANGLE_RAD:
        raise TrajectoryError(f"{where}: an angle of {largest:.4g}; expected radians, or headings such as yaw_deg")
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]
