"""PX4's own log (.ulg) beside a flight's: its topics as messages, and the relation of its clock to the flight's."""

from __future__ import annotations

import contextlib
import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError

PREFIX: Final = "/px4/"
_POSITION: Final = "vehicle_local_position"
_STEP_S: Final = 0.1
_WORST_M: Final = 0.5

_TIME: Final = "timestamp"
_PADDING: Final = "_padding"
_UNREADABLE: Final = (TypeError, ValueError, ArithmeticError, LookupError, AttributeError, EOFError, MemoryError)
"""What the parser stumbles over in a file that is damaged."""

_HEADER_BYTES: Final = 3
_MOST_BACK: Final = 100

Floats = npt.NDArray[np.float64]


class _Forward(io.BufferedReader):
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
        try:
            # Given its name, it leaves a bad file open; and what it says of damage it prints.
            with _Forward(io.FileIO(path)) as file, contextlib.redirect_stdout(io.StringIO()):
                self._log = ULog(file)
        except (ULogException, struct.error, OSError, *_UNREADABLE) as error:
            raise CompanionError(f"{path}: not a readable .ulg file: {error}") from None

    @property
    def is_damaged(self) -> bool:
        """Whether some of it could not be read."""
        return bool(self._log.file_corruption)

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """(topic, time [ns] since the autopilot's boot, JSON) of all topics, one topic after the other."""
        for data in self._log.data_list:
            if _TIME not in data.data:  # a format that was damaged
                continue
            topic = f"{PREFIX}{data.name}" + (f"_{data.multi_id}" if data.multi_id else "")
            columns = {name: values.tolist() for name, values in data.data.items() if _PADDING not in name}
            for index, t_us in enumerate(columns[_TIME]):
                row = {name: _plain(values[index]) for name, values in columns.items()}
                yield topic, int(t_us) * 1000, json.dumps(row).encode()

    def positions(self) -> tuple[Floats, Floats]:
        """Times (N,) [s since boot] and positions (N, 3) in the local frame, turned to ENU, in the order of time, less
        those that the estimator called invalid. Raises CompanionError."""
        named = (data.data for data in self._log.data_list if data.name == _POSITION)
        found = next((columns for columns in named if {_TIME, "x", "y", "z"} <= columns.keys()), None)
        if found is None:
            raise CompanionError(f"{self.path}: has no {_POSITION}; it cannot be paired by time")
        t_s = found[_TIME] * 1e-6
        p_enu_m = np.stack([found["y"], found["x"], -found["z"]], axis=1).astype(float)
        valid = np.all(np.isfinite(p_enu_m), axis=1)
        for flag in ("xy_valid", "z_valid"):
            valid &= found.get(flag, np.ones(len(t_s))) != 0
        order = np.flatnonzero(valid)[np.argsort(t_s[valid], kind="stable")]
        if len(order) < 2:
            raise CompanionError(f"{self.path}: has no valid {_POSITION}; it cannot be paired by time")
        return t_s[order], p_enu_m[order]


def clock_offset_s(path: Path, ulog: tuple[Floats, Floats], flight: tuple[Floats, Floats]) -> tuple[float, float]:
    """(offset, rms [m]): the flight's time less the autopilot's at which both saw the same positions.

    Each pair is times (N,) [s] and positions (N, 3). The speed over ground is correlated for a first guess, and the
    positions matched from there. Raises CompanionError when nothing fits to 0.5 m: not of the same flight.
    """
    their_t, our_t = ulog[0], flight[0]
    if len(our_t) < 2:
        raise CompanionError(f"{path}: the flight's log holds no positions of the vehicle to pair it by")
    theirs, ours = (_activity(*track) for track in (ulog, flight))
    lags = np.correlate(ours - ours.mean(), theirs - theirs.mean(), mode="full")
    guess = our_t[0] - their_t[0] + (int(np.argmax(lags)) - (len(theirs) - 1)) * _STEP_S
    coarse = guess + np.arange(-3, 3.001, 0.1)
    best = min(coarse, key=lambda offset: _rms_m(offset, ulog, flight))
    fine = best + np.arange(-0.1, 0.1001, 0.002)
    best = min(fine, key=lambda offset: _rms_m(offset, ulog, flight))
    rms = _rms_m(best, ulog, flight)
    if not rms < _WORST_M:
        raise CompanionError(f"{path}: not of this flight: the positions of both differ by {rms:.1f} m at best")
    return float(best), rms


def _activity(t_s: Floats, p_m: Floats) -> Floats:
    """Speed on a regular grid."""
    grid = np.arange(t_s[0], t_s[-1], _STEP_S)
    resampled = np.stack([np.interp(grid, t_s, p_m[:, axis]) for axis in range(3)], axis=1)
    return np.asarray(np.linalg.norm(np.diff(resampled, axis=0), axis=1))


def _rms_m(offset_s: float, ulog: tuple[Floats, Floats], flight: tuple[Floats, Floats]) -> float:
    (their_t, their_p), (our_t, our_p) = ulog, flight
    at = our_t - offset_s
    inside = (at >= their_t[0]) & (at <= their_t[-1])
    if np.count_nonzero(inside) < 0.5 * min(len(our_t), len(their_t)) and np.count_nonzero(inside) < 20:
        return float("inf")
    seen = np.stack([np.interp(at[inside], their_t, their_p[:, axis]) for axis in range(3)], axis=1)
    return float(np.sqrt(np.mean(np.sum((seen - our_p[inside]) ** 2, axis=1))))


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value
