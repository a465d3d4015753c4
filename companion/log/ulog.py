"""PX4's own log (.ulg) beside a flight's: its topics as messages, and the relation of its clock to the flight's."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError
from csi_bridge.foreign import foreign_format
from csi_bridge.regular_file import open_regular

PREFIX: Final = "/px4/"
_POSITION: Final = "vehicle_local_position"
_STEP_S: Final = 0.1
_WORST_M: Final = 0.5
_LEAST_MOVED_M: Final = 2.0
"""By less it cannot be told from standing still, at any other time."""
_SHORTEST_S: Final = 1.0

_MAGIC: Final = b"ULog"
_FIRST_BYTES: Final = 4096
_TIME: Final = "timestamp"
_PADDING: Final = "_padding"
_UNREADABLE: Final = (TypeError, ValueError, ArithmeticError, LookupError, AttributeError, EOFError, MemoryError)
"""What the parser stumbles over in a file that is damaged."""

_LONGEST_GAP_S: Final = 60.0
"""Where two positions are further apart, a time stamp was damaged, or the logger stood still."""
_FARTHEST_M: Final = 5.0
"""A vehicle is no further from the median of the five positions around: that one was damaged."""
_JUMP_M: Final = 0.7
_FASTEST_M_S: Final = 20.0
"""A step as long, and faster than any vehicle of ours: the estimator began anew."""
_SHORTEST_STRETCH_S: Final = 5.0
"""Of several: a shorter one would fit in too many places."""
_MOST_STRETCHES: Final = 8
"""The longest of each log are tried against each other."""
_AFTERWARDS_S: Final = 3600.0
"""Nothing is logged so long after the last position: that time was damaged."""

_HEADER_BYTES: Final = 3
_MOST_BACK: Final = 100

Floats = npt.NDArray[np.float64]


class _ForwardOnly(io.BufferedReader):
    """The parser goes round in circles in some files that are damaged and cut: this ends it. In others it goes back to
    the header of a message a few times, where sections begin."""

    _furthest = 0
    _times_back = 0

    def read(self, size: int | None = -1, /) -> bytes:
        if size == _HEADER_BYTES:
            at = self.tell()
            self._times_back += at < self._furthest
            self._furthest = max(self._furthest, at)
            if self._times_back > _MOST_BACK:
                raise EOFError("damaged, and cut off where its formats should be")
        return super().read(size)


class Ulog:
    """One file. Raises CompanionError when it cannot be read."""

    def __init__(self, path: Path) -> None:
        # Imported late: only a merge with a .ulg needs it.
        from pyulog.core import ULog
        from pyulog.exceptions import ULogException

        self.path = path
        _refuse_other_files(path)
        try:
            # Given its name, it leaves a bad file open; and what it says of damage it prints.
            with _ForwardOnly(open_regular(path).detach()) as file, contextlib.redirect_stdout(io.StringIO()):
                self._log = ULog(file)
        except (ULogException, struct.error, OSError, *_UNREADABLE) as error:
            raise CompanionError(f"{path}: not a readable .ulg file: {error}") from None

    @property
    def is_damaged(self) -> bool:
        """Whether some of it could not be read."""
        return bool(self._log.file_corruption)

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """(topic, time [ns] since the autopilot's boot, JSON) of all topics, one after the other, less what has a
        damaged time. Raises CompanionError."""
        latest_us = round((self.positions()[0][-1] + _AFTERWARDS_S) * 1e6)
        for data in self._log.data_list:
            if data.data.get(_TIME, np.empty(0)).dtype != np.uint64:  # a format that was damaged
                continue
            topic = f"{PREFIX}{data.name}" + (f"_{data.multi_id}" if data.multi_id else "")
            columns = {name: values.tolist() for name, values in data.data.items() if _PADDING not in name}
            for index, t_us in enumerate(columns[_TIME]):
                if t_us > latest_us:
                    continue
                row = {name: _plain(values[index]) for name, values in columns.items()}
                yield topic, t_us * 1000, json.dumps(row).encode()

    def positions(self) -> tuple[Floats, Floats]:
        """Times (N,) [s since boot] and positions (N, 3) in the local frame, turned to ENU, in the order of time, less
        those that the estimator called invalid and those that were damaged. Raises CompanionError."""
        named = (data.data for data in self._log.data_list if data.name == _POSITION)
        found = next((columns for columns in named if {_TIME, "x", "y", "z"} <= columns.keys()), None)
        if found is None:
            raise CompanionError(f"{self.path}: has no {_POSITION}; it cannot be paired by time")
        t_s = found[_TIME] * 1e-6
        with np.errstate(invalid="ignore"):  # a damaged number may be a signalling nan
            p_enu_m = np.stack([found["y"], found["x"], -found["z"]], axis=1).astype(float)
        valid = np.all(np.isfinite(p_enu_m), axis=1)
        for flag in ("xy_valid", "z_valid"):
            valid &= found.get(flag, np.ones(len(t_s))) != 0
        order = np.flatnonzero(valid)[np.argsort(t_s[valid], kind="stable")]
        kept = order[_undamaged(t_s[order], p_enu_m[order])]
        if len(kept) < 2:
            raise CompanionError(f"{self.path}: has no valid {_POSITION}; it cannot be paired by time")
        return t_s[kept], p_enu_m[kept]


def _refuse_other_files(path: Path) -> None:
    """Raises CompanionError that says what a file is which the parser would only find no header in."""
    try:
        with open_regular(path) as file:
            start = file.read(_FIRST_BYTES)
    except OSError as error:
        raise CompanionError(f"{path}: {error.strerror}") from None
    if not start.startswith(_MAGIC):
        what = foreign_format(start) or ("another file" if start else "empty file")
        raise CompanionError(f"{path}: not a .ulg file: {what}; expected PX4's own log")


def _undamaged(t_s: Floats, p_m: Floats) -> npt.NDArray[np.intp]:
    """Indices (K,) of the longest stretch without a gap, less what lies off the path; times (N,) sorted, (N, 3)."""
    stretches = np.split(np.arange(len(t_s)), np.flatnonzero(np.diff(t_s) > _LONGEST_GAP_S) + 1)
    longest = max(stretches, key=len)
    if len(longest) < 5:
        return longest
    padded = np.pad(p_m[longest], ((2, 2), (0, 0)), mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axis=-1)
    near = np.all(np.abs(p_m[longest] - middle) <= _FARTHEST_M, axis=1)
    return np.compress(near, longest)


def clock_offset_s(path: Path, ulog: tuple[Floats, Floats], flight: tuple[Floats, Floats]) -> tuple[float, float]:
    """(offset, rms [m]): the flight's time less the autopilot's at which both saw the same positions.

    Each pair is times (N,) [s] and positions (N, 3). Where either jumped, since the autopilot restarted or its
    estimator was reset, or where one was silent, its stretches are tried each for itself. The speed over ground is
    correlated for a first guess, and the positions matched from there. Raises CompanionError when nothing fits to 0.5 m
    over half of the shorter stretch: not of the same flight; or when nothing moved there.
    """
    if len(flight[0]) < 2:
        raise CompanionError(f"{path}: the flight's log holds no positions of the vehicle to pair it by")
    theirs, ours = _stretches(*ulog), _stretches(*flight)
    for name, longest in (("it", theirs[0]), ("the flight's log", ours[0])):
        if np.ptp(longest[0]) < _SHORTEST_S:
            span_s = np.ptp(longest[0])
            raise CompanionError(f"{path}: {name} holds positions of {span_s:.1f} s, {_SHORTEST_S:g} are needed")
    pairs = list(itertools.product(theirs[:_MOST_STRETCHES], ours[:_MOST_STRETCHES]))
    pairs.sort(key=lambda pair: min(np.ptp(pair[0][0]), np.ptp(pair[1][0])), reverse=True)
    why: CompanionError | None = None
    for number, (their_part, our_part) in enumerate(pairs):
        if number and min(np.ptp(their_part[0]), np.ptp(our_part[0])) < _SHORTEST_STRETCH_S:
            break
        try:
            return _offset_s(path, their_part, our_part)
        except CompanionError as error:
            why = why or error
    assert why is not None
    raise why


def _stretches(t_s: Floats, p_m: Floats) -> list[tuple[Floats, Floats]]:
    """Times (N,) and positions (N, 3) in pieces without jump or gap, the longest first."""
    steps_m = np.linalg.norm(np.diff(p_m, axis=0), axis=1)
    steps_s = np.diff(t_s)
    jumps = (steps_m > _JUMP_M) & (steps_m > _FASTEST_M_S * steps_s)
    cuts = np.flatnonzero(jumps | (steps_s > _LONGEST_GAP_S)) + 1
    pieces = list(zip(np.split(t_s, cuts), np.split(p_m, cuts), strict=True))
    return sorted(pieces, key=lambda piece: float(np.ptp(piece[0])), reverse=True)


def _offset_s(path: Path, ulog: tuple[Floats, Floats], flight: tuple[Floats, Floats]) -> tuple[float, float]:
    """Of two stretches. Raises CompanionError."""
    their_t, our_t = ulog[0], flight[0]
    theirs, ours = (_activity(*track) for track in (ulog, flight))
    lags = np.correlate(ours - ours.mean(), theirs - theirs.mean(), mode="full")
    guess = our_t[0] - their_t[0] + (int(np.argmax(lags)) - (len(theirs) - 1)) * _STEP_S
    coarse = guess + np.arange(-3, 3.001, 0.1)
    best = min(coarse, key=lambda offset: _rms_m(offset, ulog, flight))
    fine = best + np.arange(-0.1, 0.1001, 0.002)
    best = min(fine, key=lambda offset: _rms_m(offset, ulog, flight))
    rms = _rms_m(best, ulog, flight)
    if not rms < _WORST_M:
        how = f"differ by {rms:.1f} m at best" if rms < math.inf else "have less than half of the shorter log in common"
        raise CompanionError(f"{path}: not of this flight: the positions of both {how}")
    moved_m = float(np.linalg.norm(np.ptp(flight[1][_inside(best, their_t, our_t)], axis=0)))
    if moved_m < _LEAST_MOVED_M:
        needed = f"{_LEAST_MOVED_M:g} m tell when that was"
        raise CompanionError(f"{path}: the vehicle moved {moved_m:.1f} m where both logs could agree; {needed}")
    return float(best), rms


def _activity(t_s: Floats, p_m: Floats) -> Floats:
    """Speed on a regular grid."""
    grid = np.arange(t_s[0], t_s[-1], _STEP_S)
    resampled = np.stack([np.interp(grid, t_s, p_m[:, axis]) for axis in range(3)], axis=1)
    return np.asarray(np.linalg.norm(np.diff(resampled, axis=0), axis=1))


def _rms_m(offset_s: float, ulog: tuple[Floats, Floats], flight: tuple[Floats, Floats]) -> float:
    (their_t, their_p), (our_t, our_p) = ulog, flight
    inside = _inside(offset_s, their_t, our_t)
    in_both_s = min(our_t[-1], their_t[-1] + offset_s) - max(our_t[0], their_t[0] + offset_s)
    if not np.any(inside) or in_both_s < 0.5 * min(np.ptp(our_t), np.ptp(their_t)):
        return float("inf")
    at = our_t - offset_s
    seen = np.stack([np.interp(at[inside], their_t, their_p[:, axis]) for axis in range(3)], axis=1)
    return float(np.sqrt(np.mean(np.sum((seen - our_p[inside]) ** 2, axis=1))))


def _inside(offset_s: float, their_t: Floats, our_t: Floats) -> npt.NDArray[np.bool_]:
    """(N,) which of our times their log covers."""
    return np.asarray((our_t - offset_s >= their_t[0]) & (our_t - offset_s <= their_t[-1]))


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value
