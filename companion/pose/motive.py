"""OptiTrack Motive's CSV export of one rigid body: a block of headings, then frames; Y up, seconds of the take.

Layout: first line key,value pairs (Format Version, Rotation Type, Length Units, ...), then rows of type, name, ID and
Rotation or Position above `Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,...`. Poses of frames in which the body was not seen are
empty.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from companion.pose.trajectory_columns import TrajectoryError

LAYOUT: Final = "an OptiTrack Motive export, whose time counts from the start of its take"
_EXPECTED: Final = "expected one rigid body with Rotation Type Quaternion"
_METRES: Final = {"meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3}
_HEADER_ROWS: Final = 12

Row = tuple[int, list[str]]
"""Line number and fields."""


def is_motive(rows: Sequence[Row]) -> bool:
    return bool(rows) and rows[0][1][0].strip().lower() == "format version"


def motive_rows(path: str, rows: Sequence[Row]) -> tuple[list[tuple[int, list[float]]], int]:
    """Line number and t, x, y, z, qx, qy, qz, qw (ENU, metres) of each frame, and how many frames had no pose. Raises
    TrajectoryError, which says that it is Motive's and what is expected instead."""
    pairs = [field.strip().lower() for field in rows[0][1]]
    about = dict(zip(pairs[::2], pairs[1::2], strict=False))
    metres = _METRES.get(about.get("length units", ""))
    if metres is None or about.get("rotation type") != "quaternion":
        given = f"Rotation Type {about.get('rotation type')}, Length Units {about.get('length units')}"
        raise _error(path, f"{given}; {_EXPECTED} and Length Units Meters, Centimeters or Millimeters")
    space = about.get("coordinate space", "global")
    if space != "global":
        raise _error(path, f"Coordinate Space {space}, which says nothing of where the body is; expected Global")
    at, columns = _columns(path, rows)
    found, unseen = [], 0
    for number, fields in rows[at:]:
        texts = [fields[column].strip() if column < len(fields) else "" for column in columns]
        if texts[0] and not any(texts[1:]):
            unseen += 1
            continue
        try:
            t_s, qx, qy, qz, qw, x, y, z = map(float, texts)
        except ValueError:
            raise _error(path, f"line {number} is no frame: {','.join(fields)[:60]!r}") from None
        # Y up to Z up: a quarter turn about X.
        found.append((number, [t_s, x * metres, -z * metres, y * metres, qx, -qz, qy, qw]))
    return found, unseen


def _columns(path: str, rows: Sequence[Row]) -> tuple[int, list[int]]:
    """Where the frames begin, and the columns of time, rotation X, Y, Z, W and position X, Y, Z."""
    head = next((n for n, row in enumerate(rows[:_HEADER_ROWS]) if row[1][0].strip().lower() == "frame"), None)
    if head is None or head < 3:
        raise _error(path, f"no line Frame,Time (Seconds),...; {_EXPECTED}")
    names, above = [[field.strip().lower() for field in rows[n][1]] for n in (head, head - 1)]
    kinds = next((row[1] for row in rows[1:head] if any(field.strip().lower() == "rigid body" for field in row[1])), [])
    labels = _below(rows[1:head], kinds)
    bodies = [n for n, kind in enumerate(kinds) if kind.strip().lower() == "rigid body"]
    called = list(dict.fromkeys(labels[n].strip() for n in bodies if n < len(labels)))
    if len(called) != 1:
        raise _error(path, f"{len(called)} rigid bodies ({', '.join(called[:6]) or 'none'}); {_EXPECTED}")
    found = [1]
    for kind, axes in (("rotation", "xyzw"), ("position", "xyz")):
        of_kind = [n for n in bodies if n < len(above) and above[n] == kind]
        found += [n for axis in axes for n in of_kind if names[n] == axis]
    if len(found) != 8:
        raise _error(path, f"columns Rotation X, Y, Z, W and Position X, Y, Z not found; {_EXPECTED}")
    return head + 1, found


def _below(rows: Sequence[Row], kinds: list[str]) -> list[str]:
    """The row of names under the row of types."""
    places = [n for n, row in enumerate(rows) if row[1] is kinds]
    return rows[places[0] + 1][1] if places and places[0] + 1 < len(rows) else []


def _error(path: str, text: str) -> TrajectoryError:
    return TrajectoryError(f"{path}: an OptiTrack Motive export: {text}")
