"""Which column of a trajectory file holds what: by its headings, else by one of the documented layouts (no third way).

The layouts without headings are those of docs/recordings.md; whatever else has none is refused, because a column taken
for its neighbour gives a trajectory that looks like one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from companion.errors import CompanionError

EXPECTED: Final = "expected headings t (or sec, nsec), x, y, z and, with attitudes, qx, qy, qz, qw"
_SHOWN: Final = 16
_WSR: Final = "the WSR data sets' CSV"
_WSR_PLACE: Final = 5
_WSR_ATTITUDE: Final = 9
"""And more: the data sets have six rates behind the quaternion. Its norm, and whole nanoseconds, prove the layout."""
_TUM: Final = 8
_KITTI: Final = 12

_AXIS: Final = r"(?:.*_)?(?:position|pos|translation|p_rs_r)_{0}|pose_{0}|[pt]?_?{0}|{1}"
_TURN: Final = r"(?:.*_)?(?:orientation|rotation|quaternion|quat|attitude|q|q_rs)_{0}|q{0}"
_MEANINGS: Final[Mapping[str, re.Pattern[str]]] = MappingProxyType(
    {
        "t": re.compile(r"t|stamp|(?:log_|unix_)?time|(?:.*_)?(?:timestamp|header_stamp)|time_?stamp"),
        "sec": re.compile(r"(?:.*_)?(?:sec|secs|seconds)"),
        "nsec": re.compile(r"(?:.*_)?(?:nsec|nsecs|nanosec|nanosecs|nanoseconds)"),
        **{
            axis: re.compile(_AXIS.format(axis, name))
            for axis, name in zip("xyz", ("east", "north", "up"), strict=True)
        },
        **{f"q{part}": re.compile(_TURN.format(part)) for part in "xyzw"},
        **{angle: re.compile(rf"(?:.*_)?{angle}") for angle in ("roll", "pitch", "yaw")},
    }
)
_TIME_UNITS: Final = {
    **dict.fromkeys(("", "s", "sec", "seconds"), 1.0),
    **dict.fromkeys(("ms", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanoseconds"), 1e-9),
}
_LENGTH_UNITS: Final = {
    **dict.fromkeys(("", "m", "meters", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeters", "centimetres"), 1e-2),
    **dict.fromkeys(("mm", "millimeters", "millimetres"), 1e-3),
}
_ANGLE_UNITS: Final = {
    "": 1.0,
    "rad": 1.0,
    "radians": 1.0,
    "deg": 0.017453292519943295,
    "degrees": 0.017453292519943295,
}
_UNIT: Final = re.compile(r"[\[(]([^\])]*)[\])]")
_NOT_MEASURED: Final = re.compile(
    r"(?:.*_)?(?:set_?point|sp|goal|desired|ref|reference|cmd|command|err|error|cov|covariance|std|stddev|sigma|rms|var"
    r"|variance|vel|velocity|acc|acceleration|target|waypoint|wp|home|planned|expected)(?:_.*)?"
)
"""Beside a pose there may be what was asked for, and how sure it is: neither is a place."""
_OTHER_AXES: Final = frozenset({"ned", "frd", "nwu", "nue", "rdf", "ecef", "lla", "wgs84", "optical"})
"""Words of a heading that say that its axes are not East, North, Up."""
_PX4_FIELDS: Final = frozenset(
    {
        "timestamp_sample",
        "ref_timestamp",
        "ref_lat",
        "ref_lon",
        "xy_valid",
        "z_valid",
        "v_xy_valid",
        "z_deriv",
        "delta_z",
    }
)
_PX4_SHORT: Final = frozenset({"vx", "vy", "vz", "heading"})
_PX4_TOPIC: Final = "vehicle_local_position"
"""Of PX4, which calls its axes x, y, z and says nowhere in the file that they are North, East, Down."""
_OTHER_TURN: Final = re.compile(
    r"(?:.*_)?(?:(?:q|quat|quaternion|orientation|rotation|attitude)_?(?:\d|[rijk])|r_?[xyzw])"
)
"""An attitude in one of several orders, or a rotation vector, or angles: nobody can tell."""
_UNUSED_TURN: Final = re.compile(
    r"(?:.*_)?(?:heading|hdg|course|azimuth|bearing|theta|psi|phi|roll|pitch|(?:rot|rvec|euler)_?[xyzw\d])"
)
"""About which axis or from where an angle counts, it does not say; roll and pitch are none without a yaw."""
_INDEX: Final = re.compile(r"\[(\d+)\]")
_SUFFIX: Final = re.compile(r"(.+)_(ns|us|ms|s|m|cm|mm|deg|rad)")


class TrajectoryError(CompanionError):
    """A trajectory file cannot be used; the message names the file and the line or the headings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Where things are in each row, and what turns them into seconds, metres and radians."""

    layout: str
    """What the file was taken for, in words."""
    width: int
    exact: bool
    """Every row has `width` fields, none of them empty: there are no headings that would show a shifted one."""
    time: int
    time_scale: float
    nsec: int | None
    """Nanoseconds beside whole seconds in `time`."""
    place: tuple[int, int, int]
    place_scale: float = 1.0
    attitude: tuple[int, int, int, int] | None = None
    """qx, qy, qz, qw."""
    angles: tuple[int | None, int | None, int] | None = None
    """roll, pitch, yaw where there is no quaternion; level where only the yaw is told."""
    angle_scale: float = 1.0
    names: tuple[str, ...] = ()
    """The headings, or those of the layout."""
    other_time: tuple[int, float] | None = None
    """Column and scale of the recorder's stamps, where the message has its own."""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Heading:
    index: int
    text: str
    name: str
    unit: str


def columns_by_layout(path: str, line: int, count: int, separator: str | None) -> Columns:
    """Of rows without headings, `count` fields wide, the first at `line`; None separates by blanks. Raises
    TrajectoryError for what is not documented."""
    if separator == "," and (count == _WSR_PLACE or count >= _WSR_ATTITUDE):
        names = ("sec", "nsec", "x", "y", "z", "qx", "qy", "qz", "qw")[:count]
        turn = (5, 6, 7, 8) if count >= _WSR_ATTITUDE else None
        return Columns(
            layout=_WSR,
            width=count,
            exact=True,
            time=0,
            time_scale=1.0,
            nsec=1,
            place=(2, 3, 4),
            attitude=turn,
            names=names,
        )
    if separator is None and count == _TUM:
        names = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
        return Columns(
            layout="TUM",
            width=count,
            exact=True,
            time=0,
            time_scale=1.0,
            nsec=None,
            place=(1, 2, 3),
            attitude=(4, 5, 6, 7),
            names=names,
        )
    where = f"{path}: line {line} has {count} columns"
    if separator is None and count == _KITTI:
        raise TrajectoryError(f"{where} and no headings: KITTI poses (3x4 matrices) have no time; expected TUM or CSV")
    kind = "blanks" if separator is None else f"{separator!r}"
    index = " (an index before TUM's eight?)" if separator is None and count == _TUM + 1 else ""
    raise TrajectoryError(
        f"{where} separated by {kind}{index} and no headings, expected sec, nsec, x, y, z[, qx, qy, qz, qw, ...] "
        f"with commas or TUM's t x y z qx qy qz qw with blanks; for any other order, {EXPECTED}"
    )


def columns_by_headings(path: str, texts: Sequence[str]) -> Columns:
    """Raises TrajectoryError, which lists the headings, where one is missing or two say the same."""
    shown = ", ".join(text.strip() for text in texts[:_SHOWN]) + (", ..." if len(texts) > _SHOWN else "")
    found = _meanings(texts)
    notes: list[str] = []
    other = _own_stamp(found, notes)
    for key, headings in found.items():
        if len(headings) > 1:
            both = " and ".join(heading.text for heading in headings[:2])
            raise TrajectoryError(f"{path}: headings {both} both say {key}; expected one (headings: {shown})")
    if {"t", "sec"} <= found.keys():
        both = f"{found['t'][0].text} and {found['sec'][0].text}"
        raise TrajectoryError(f"{path}: headings {both} are both a time; expected one (headings: {shown})")
    quaternion = [key for key in ("qx", "qy", "qz", "qw") if key in found]
    missing = [key for key in "xyz" if key not in found]
    missing += [key for key in ("qx", "qy", "qz", "qw") if quaternion and key not in found]
    if "t" not in found and "sec" not in found:
        missing.insert(0, "a time")
    if missing:
        raise TrajectoryError(f"{path}: {', '.join(missing)} missing in its headings ({shown}); {EXPECTED}")
    (time,) = found["t"] if "t" in found else found["sec"]
    nsec = found["nsec"][0].index if "sec" in found and "nsec" in found else None
    x, y, z = (found[axis][0] for axis in "xyz")
    _refuse_other_axes(path, (x, y, z), {_heading(0, text).name for text in texts})
    angles = _angles(found, bool(quaternion))
    if not quaternion and angles is None:
        _refuse_other_turns(path, texts)
        notes += _unused_turns(texts)
    turn = found["yaw"][0] if angles is not None else None
    place_scale = _scale(path, x, _LENGTH_UNITS)
    _check_one_unit(path, [found[axis][0] for axis in "xyz"])
    if angles is not None:
        _check_one_unit(path, [found[key][0] for key in ("yaw", "pitch", "roll") if key in found])
    if turn is not None and not turn.unit:
        notes.append(f"{turn.text} is taken for radians: its heading does not say")
    if not time.unit and x.name == "p_rs_r_x":  # EuRoC's ground truth, whose stamps are nanoseconds
        time = replace(time, unit="ns")
    qx, qy, qz, qw = (found[key][0].index if quaternion else 0 for key in ("qx", "qy", "qz", "qw"))
    return Columns(
        layout=f"CSV by its headings ({shown})",
        width=len(texts),
        exact=False,
        time=time.index,
        time_scale=_scale(path, time, _TIME_UNITS),
        nsec=nsec,
        place=(x.index, y.index, z.index),
        place_scale=place_scale,
        attitude=(qx, qy, qz, qw) if quaternion else None,
        angles=angles,
        angle_scale=1.0 if turn is None else _scale(path, turn, _ANGLE_UNITS),
        names=tuple(text.strip() for text in texts),
        other_time=None if other is None else (other.index, _scale(path, other, _TIME_UNITS)),
        notes=tuple(f"{path}: {note}" for note in notes),
    )


def _check_one_unit(path: str, headings: Sequence[_Heading]) -> None:
    """Raises TrajectoryError where one says millimetres and the next does not."""
    first = headings[0]
    for other in headings[1:]:
        if other.unit != first.unit:
            raise TrajectoryError(
                f"{path}: headings {first.text} and {other.text} are not of one unit; expected the same for all of them"
            )


def _refuse_other_axes(path: str, places: Sequence[_Heading], names: Set[str]) -> None:
    """Raises TrajectoryError for a place whose heading, or those beside it, `names`, tell axes that are not ours."""
    plain = [place.name for place in places] == ["x", "y", "z"]
    if any(_PX4_TOPIC in place.name for place in places) or (plain and (names & _PX4_FIELDS or names >= _PX4_SHORT)):
        raise TrajectoryError(
            f"{path}: headings {', '.join(place.text for place in places)} are PX4's {_PX4_TOPIC}, which is NED: "
            "x North, y East, z down; turn it to columns east, north, up: its y, its x, and its z with the other sign"
        )
    for place in places:
        named = next((word for word in place.name.split("_") if word in _OTHER_AXES), None)
        if named is not None:
            raise TrajectoryError(
                f"{path}: heading {place.text} says {named}; expected x, y, z turned to East, North, Up"
            )


def _refuse_other_turns(path: str, texts: Sequence[str]) -> None:
    others = [text.strip() for text in texts if _OTHER_TURN.fullmatch(_heading(0, text).name)]
    if others:
        raise TrajectoryError(
            f"{path}: headings {', '.join(others)} may be an attitude in any order; expected qx, qy, qz, qw"
        )


def _unused_turns(texts: Sequence[str]) -> list[str]:
    unused = [text.strip() for text in texts if _UNUSED_TURN.fullmatch(_heading(0, text).name)]
    told = "no attitude that is read: expected qx, qy, qz, qw, or yaw counter-clockwise from x"
    return [f"{', '.join(unused)} not used, {told}"] if unused else []


def are_headings(texts: Sequence[str]) -> bool:
    """Whether a comment's words are headings of a trajectory: a time and a place among them."""
    found = _meanings(texts)
    return {"x", "y", "z"} <= found.keys() and bool({"t", "sec"} & found.keys())


def _meanings(texts: Sequence[str]) -> dict[str, list[_Heading]]:
    found: dict[str, list[_Heading]] = {}
    for index, text in enumerate(texts):
        heading = _heading(index, text)
        if _NOT_MEASURED.fullmatch(heading.name):
            continue
        for key, pattern in _MEANINGS.items():
            if pattern.fullmatch(heading.name):
                found.setdefault(key, []).append(heading)
                break
    return found


def _heading(index: int, text: str) -> _Heading:
    """`#timestamp [ns]`, `x_mm`, `pose.position.x`: the name in words joined by underscores, and its unit."""
    plain = text.strip().strip("\"'")
    plain_name = _INDEX.sub(r"_\1", plain)  # of `q[0]`, what is in brackets is no unit
    unit = _UNIT.search(plain_name)
    name = re.sub(r"[^a-z0-9]+", "_", _UNIT.sub("", plain_name).lower()).strip("_")
    if unit is not None:
        return _Heading(index, plain, name, unit[1].strip().lower())
    suffixed = _SUFFIX.fullmatch(name)
    if suffixed is not None and any(pattern.fullmatch(suffixed[1]) for pattern in _MEANINGS.values()):
        return _Heading(index, plain, suffixed[1], suffixed[2])
    # `rostopic echo -p` writes both as nanoseconds.
    is_ros = plain.startswith("%time") or name == "field_header_stamp"
    return _Heading(index, plain, name, "ns" if is_ros else "")


def _own_stamp(found: dict[str, list[_Heading]], notes: list[str]) -> _Heading | None:
    """Where a message has a stamp of its own beside the recorder's, its own is used; the recorder's is returned."""
    stamps = [one for one in (*found.get("t", []), *found.get("sec", [])) if "header" in one.name]
    others = [one for one in found.get("t", []) if "header" not in one.name]
    if len(stamps) != 1 or len(others) != 1:
        return None
    notes.append(f"stamps are those of {stamps[0].text}, not {others[0].text}")
    if stamps[0] in found["t"]:
        found["t"] = stamps
    else:
        del found["t"]
    return others[0]


def _angles(found: Mapping[str, list[_Heading]], has_quaternion: bool) -> tuple[int | None, int | None, int] | None:
    if has_quaternion or "yaw" not in found:
        return None
    roll, pitch = (found[key][0].index if key in found else None for key in ("roll", "pitch"))
    return roll, pitch, found["yaw"][0].index


def _scale(path: str, heading: _Heading, units: Mapping[str, float]) -> float:
    try:
        return units[heading.unit]
    except KeyError:
        known = ", ".join(unit for unit in units if unit)
        raise TrajectoryError(
            f"{path}: unit {heading.unit!r} of {heading.text} is not known; expected {known}"
        ) from None
