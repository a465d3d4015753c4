"""What no trajectory of a robot in metres and seconds can look like: units, stamps and quaternions, by line."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from companion.pose.trajectory_columns import TrajectoryError

Array = npt.NDArray[np.float64]
Lines = npt.NDArray[np.int64]

MAX_POSITION_M: Final = 1e5
"""No building is that large: a number beyond is no place."""
_MAX_EXTENT_M: Final = 5e3
"""WiFi is not heard so far."""
_MAX_SPEED_M_S: Final = 30.0
_MAX_STEADY_M_S: Final = 10.001
"""Over seconds. Twice what 200 packets a second sample at 5 GHz, and a slow robot's in centimetres."""
_STEADY_S: Final = 2.0
_MAX_FAST: Final = 0.1
"""Share of the path: a tracker that lost itself may jump now and then, another unit is fast everywhere."""
_SPEED_OVER_S: Final = 0.5
_PATH_STEP_S: Final = 0.02
_MAX_STAMP_S: Final = 1e10
_UNITS: Final = ((1e17, "nanoseconds"), (1e14, "microseconds"), (1e11, "milliseconds"), (0.0, "another unit"))
_STEP_UNITS: Final = ((1e6, "ns", "nanoseconds"), (1e3, "us", "microseconds"), (0.0, "ms", "milliseconds"))
_PX4: Final = ". PX4, whose stamps are microseconds, has x North, y East, z down: turn them to East, North, Up too"
_MAX_INTERVAL_S: Final = 1.0
_LEAST_INTERVAL_S: Final = 5e-4
_MANY: Final = 10
_MAX_EQUAL: Final = 0.5
_LEAST_FRACTION: Final = 0.01
"""Over seconds, stamps at any rate reach beyond it."""
_MAX_STEPPED_BACK: Final = 0.1
_MAX_NORM_ERROR: Final = 0.1
_TIPPED, _LEVEL = 0.25, 0.03
"""Squares of the sine of half the tilt: 60 and 20 degrees."""


def check_stamps(path: str, lines: Lines, t_s: Array) -> None:
    """Raises TrajectoryError for stamps (N,) that are not seconds."""
    wrong = np.flatnonzero(np.abs(t_s) > _MAX_STAMP_S)
    if len(wrong):
        value = float(t_s[wrong[0]])
        unit = next(unit for least, unit in _UNITS if abs(value) >= least)
        raise TrajectoryError(
            f"{path}: line {lines[wrong[0]]} is stamped {value:.10g}; expected seconds. If these are {unit}, a heading "
            f"such as `timestamp [ns]` says so{_PX4 if unit == 'microseconds' else ''}"
        )
    steps_s = np.diff(t_s)
    if len(t_s) >= _MANY and np.median(steps_s) >= _MAX_INTERVAL_S:
        at = int(np.argmax(steps_s >= _MAX_INTERVAL_S)) + 1
        _, short, unit = next(one for one in _STEP_UNITS if np.median(steps_s) >= one[0])
        raise TrajectoryError(
            f"{path}: line {lines[at]} is stamped {steps_s[at - 1]:.6g} s after the one before, and so is most of it; "
            f"expected seconds, poses less than 1 s apart. Are these {unit}? A heading `time_{short}` says so"
            f"{_PX4 if short == 'us' else ''}"
        )
    if len(t_s) >= _MANY and np.mean(steps_s == 0) > _MAX_EQUAL:
        at = int(np.argmax(steps_s == 0)) + 1
        raise TrajectoryError(
            f"{path}: line {lines[at]} has the stamp of the one before, {t_s[at]:.10g}, as most of it has; expected "
            "seconds with their fraction, or sec and nsec"
        )
    if len(t_s) >= _MANY and t_s[-1] - t_s[0] > 2 * _MAX_INTERVAL_S and np.max(t_s % 1.0) < _LEAST_FRACTION:
        raise TrajectoryError(
            f"{path}: every stamp is within {_LEAST_FRACTION:g} s of a whole second, from line {lines[0]} on; expected "
            "nanoseconds beside the seconds, not micro- or milliseconds"
        )
    if len(t_s) >= _MANY and np.median(steps_s) < _LEAST_INTERVAL_S:
        raise TrajectoryError(
            f"{path}: {1 / np.median(steps_s):.4g} poses a second from line {lines[0]} on; expected seconds, "
            f"{1 / _LEAST_INTERVAL_S:g} poses or fewer in one. Are these minutes?"
        )


def check_places(path: str, lines: Lines, p_m: Array) -> None:
    """Raises TrajectoryError for positions (N, 3) that are no places of a robot near its origin."""
    far = np.flatnonzero((np.abs(p_m) > MAX_POSITION_M).any(axis=1))
    if len(far):
        away = float(np.abs(p_m[far[0]]).max())
        raise TrajectoryError(
            f"{path}: line {lines[far[0]]} is {away:.3g} m away; expected below 1e5 m, metres from an origin nearby "
            "(no map coordinates such as UTM)"
        )
    extent_m = np.abs(p_m - p_m[0]).max(axis=1)
    at = int(np.argmax(extent_m))
    if extent_m[at] > _MAX_EXTENT_M:
        raise TrajectoryError(
            f"{path}: line {lines[at]} is {extent_m[at]:.4g} m from the first pose; expected below 5000, in metres. If "
            "these are millimetres, a heading such as `x [mm]` says so"
        )


def check_speed(path: str, lines: Lines, t_s: Array, p_m: Array) -> None:
    """Raises TrajectoryError where the robot would be faster than any that carries this."""
    steps_s = np.diff(t_s)
    if not len(steps_s):
        return
    usual_s = max(float(np.median(steps_s)), 1e-6)
    apart = min(len(steps_s), max(1, int(np.ceil(_SPEED_OVER_S / usual_s))))
    over_s = t_s[apart:] - t_s[:-apart]
    # Along the path: what goes in circles in another unit of time comes back to where it was. By coarse steps, since
    # noise of each position goes a way too.
    nodes = np.unique([*range(0, len(t_s), max(1, int(_PATH_STEP_S / usual_s))), len(t_s) - 1])
    nodes_m = np.cumsum(np.linalg.norm(np.diff(p_m[nodes], axis=0, prepend=p_m[:1]), axis=1))
    way_m = np.interp(np.arange(len(t_s)), nodes, nodes_m)
    speed_m_s = (way_m[apart:] - way_m[:-apart]) / np.maximum(over_s, 1e-9)
    limits_m_s = (_MAX_SPEED_M_S, _MAX_STEADY_M_S) if t_s[-1] - t_s[0] > _STEADY_S else (_MAX_SPEED_M_S,)
    for most_m_s in limits_m_s:
        fast = np.flatnonzero((speed_m_s > most_m_s) & (over_s > 0))
        if len(fast) > _MAX_FAST * len(speed_m_s):
            at = int(fast[0])
            raise TrajectoryError(
                f"{path}: line {lines[at + apart]} is {speed_m_s[at]:.4g} m/s after line {lines[at]}; expected below "
                f"{most_m_s:.0f}, positions in metres and stamps in seconds. If these are millimetres or centimetres, "
                "a heading such as `x [mm]` says so"
            )


def check_quaternions(path: str, lines: Lines, q: Array) -> Array:
    """(N, 4), w first, made unit. Raises TrajectoryError where a norm is off 1 by more than 0.1: those are no
    quaternions; and where they make sense in the other order alone."""
    norm = np.linalg.norm(q, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1) > _MAX_NORM_ERROR)
    if len(wrong):
        raise TrajectoryError(
            f"{path}: line {lines[wrong[0]]} has a quaternion of norm {norm[wrong[0]]:.3g}; expected 1 within 0.1 "
            "(qx, qy, qz, qw in this order, unless headings say otherwise)"
        )
    unit = np.asarray(q / norm[:, None])
    if _tilt(unit[:, 1], unit[:, 2]) > _TIPPED and _tilt(unit[:, 2], unit[:, 3]) < _LEVEL:
        raise TrajectoryError(
            f"{path}: from line {lines[0]} on the robot lies on its side or back, and with w first it would stand. "
            "Expected qx, qy, qz, qw in this order, unless headings say otherwise"
        )
    return unit


def _tilt(qx: Array, qy: Array) -> float:
    """Square of the sine of half the tilt, in the middle of a recording."""
    return float(np.median(qx**2 + qy**2))


def in_order(path: str, lines: Lines, t_s: Array, notes: list[str]) -> npt.NDArray[np.bool_]:
    """Which rows (N,) are stamped no earlier than any before. A few others are left out and said: there the logger's
    clock stepped back, and sorted by time they would stand between poses that they do not belong to. Raises
    TrajectoryError for many."""
    late = np.zeros(t_s.size, np.bool_)
    late[1:] = t_s[1:] < np.maximum.accumulate(t_s)[:-1]
    if not np.any(late):
        return ~late
    first, count = int(np.argmax(late)), int(late.sum())
    if late.mean() > _MAX_STEPPED_BACK:
        raise TrajectoryError(
            f"{path}: line {lines[first]} is stamped before one above, and so are {count} of {late.size}; expected "
            "poses in order of time, by a clock that is not set meanwhile"
        )
    notes.append(
        f"{path}: {count} poses left out from line {lines[first]} on, whose clock stepped back over earlier ones"
    )
    return ~late
