"""What is wrong with the rows of a trajectory file before any of them is a number: told by line and column."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from companion.pose.motive import Row
from companion.pose.trajectory_columns import TrajectoryError

_WHOSE: Final = re.compile(
    r"topic|name|id|(?:.*[_. ])?frame_id"
    r"|(?:(?:rigid[_ ]?)?body|object|subject|robot|vehicle|agent)(?:[_ ]?(?:id|name))?",
    re.IGNORECASE,
)
_MOST_BODIES: Final = 50
"""More are numbers of frames that begin again."""
_HALF: Final = re.compile(r"0\d+")
_LOOKED_AT: Final = 1000
_UNITS: Final = re.compile(r"[\[(]?(?:n|u|m)?s(?:ec)?[\])]?|[\[(]?(?:c|m)?m[\])]?|[\[(]?(?:rad|deg)[\])]?|[-1]?")


def check_one_body(path: str, names: Sequence[str], rows: Sequence[Row]) -> None:
    """Raises TrajectoryError where a column says that rows of several bodies are mixed: its values come by turns."""
    for column in (at for at, name in enumerate(names) if _WHOSE.fullmatch(name.strip())):
        seen, last = dict[str, int](), ""
        for line, fields in rows:
            value = fields[column].strip() if column < len(fields) else ""
            if not value:
                continue
            if value in seen and value != last and len(seen) <= _MOST_BODIES:
                raise TrajectoryError(
                    f"{path}: line {line} is of {names[column].strip()} {value[:40]} again, after {last[:40]} in line "
                    f"{seen[last]}: rows of several are mixed; expected those of one"
                )
            seen[value] = line
            last = value


def check_rows_once(path: str, rows: Sequence[Row]) -> None:
    """Raises TrajectoryError where most rows are there twice: each beside itself, or all of them again."""
    rows = [row for row in rows if "nan" not in "".join(row[1]).lower()]  # those of a lost body may be all alike
    if len(rows) < 2:
        return
    again = [at for at in range(1, len(rows)) if rows[at][1] == rows[at - 1][1]]
    if 2 * len(again) > len(rows) - 1:
        first, count = again[0], len(again)
        raise TrajectoryError(
            f"{path}: line {rows[first][0]} is line {rows[first - 1][0]} again, and so are {count} of {len(rows)} "
            "rows; expected each once"
        )
    half = len(rows) // 2
    if rows[half][1] == rows[0][1] and [row for _, row in rows[half:]] == [row for _, row in rows[:half]]:
        raise TrajectoryError(f"{path}: from line {rows[half][0]} on all rows are there again; expected each once")


def check_no_halves(path: str, rows: Sequence[Row]) -> None:
    """Raises TrajectoryError where rows without headings hold what a decimal comma leaves of a number: `1,05` between
    commas is 1 and 05, and no number begins so. A nanosecond, the second column, may."""
    for line, fields in rows[:_LOOKED_AT]:
        for column, field in enumerate(fields[2:], start=3):
            if _HALF.fullmatch(field.strip()):
                raise TrajectoryError(
                    f"{path}: line {line} has {field.strip()} in column {column}, half a number with a decimal "
                    "comma; expected decimal points"
                )


def check_no_units(path: str, rows: Sequence[Row]) -> None:
    """Raises TrajectoryError where the first row below the headings holds their units."""
    if not rows:
        return
    line, fields = rows[0]
    if any(map(str.isalpha, "".join(fields))) and all(_UNITS.fullmatch(field.strip()) for field in fields):
        told = ", ".join(field.strip() for field in fields)[:60]
        raise TrajectoryError(
            f"{path}: line {line} is a row of units ({told}); expected them in headings such as `x [mm]`"
        )
