"""The path of one robot by its own poses, as far back as the estimate reaches."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.core.messages import Vector3

Array = npt.NDArray[np.float64]
Times = npt.NDArray[np.int64]

_APART_NS: Final = 150_000_000
"""Places nearer in time than this tell nothing new."""
_JOINED_NS: Final = 1_000_000_000
"""Between two places farther apart the path is not interpolated as if it were known."""
_SPEED_M_S: Final = 1.0
"""How fast a robot may have gone while nothing was heard of it; 1 σ."""
_ELSEWHERE_M: Final = 20.0
"""After a restart its frame has another origin: it may be anywhere."""
_JUMP_M: Final = 0.5
_FASTEST_M_S: Final = 5.0
"""A step that is longer than both say is none: its poses have found themselves again somewhere else."""


class Steps(NamedTuple):
    """From M times to others, by the robot's own poses: `moved_m` (M, 3) in its axes, the deviation `unknown_m` (M,) of
    what those do not say, `length_m` (M,) of path, and whether its frame is another one since (M,)."""

    moved_m: Array
    unknown_m: Array
    length_m: Array
    is_new_frame: npt.NDArray[np.bool_]


class _Places(NamedTuple):
    p_m: Array
    frame: Times
    gap_s: Array
    """In time from the nearest known place, 0 where the path is known."""
    length_m: Array
    """Of path up to here."""


class Track:
    """Places in the order of time; one that comes late or too soon after another is passed over. After another boot, or
    a step that nothing can make, they are of another frame."""

    def __init__(self) -> None:
        self._t_ns: list[int] = []
        self._p_m: list[Vector3] = []
        self._frame: list[int] = []
        self._boot = 0
        self._arrays: tuple[Times, Array, Times, Array] | None = None

    def add(self, t_ns: int, p_m: Vector3, boot: int) -> None:
        frame = 0
        if self._t_ns:
            elapsed_ns = t_ns - self._t_ns[-1]
            if elapsed_ns < _APART_NS:
                return
            is_jump = math.dist(p_m, self._p_m[-1]) > max(_JUMP_M, _FASTEST_M_S * elapsed_ns * 1e-9)
            frame = self._frame[-1] + (is_jump or boot != self._boot)
        self._boot = boot
        self._t_ns.append(t_ns)
        self._p_m.append(p_m)
        self._frame.append(frame)
        self._arrays = None

    def forget_before(self, t_ns: int) -> None:
        """All but the last place before `t_ns`."""
        count = max(0, bisect_right(self._t_ns, t_ns) - 1)
        if count:
            del self._t_ns[:count], self._p_m[:count], self._frame[:count]
            self._arrays = None

    @property
    def newest_ns(self) -> int | None:
        return self._t_ns[-1] if self._t_ns else None

    def knows(self, t_ns: Times) -> npt.NDArray[np.bool_]:
        """(M,): whether one of its places is near in time."""
        if not self._t_ns:
            return np.zeros(len(t_ns), np.bool_)
        times, after = self._stacked()[0], self._after(t_ns)
        return np.asarray(np.minimum(abs(times[after] - t_ns), abs(times[after - 1] - t_ns)) <= _JOINED_NS)

    def steps(self, from_ns: Times, to_ns: Times) -> Steps:
        """The ways from M times to M others, which may be the earlier ones."""
        elapsed_s = np.abs(to_ns - from_ns) * 1e-9
        if not self._t_ns:
            nothing = np.zeros(len(from_ns))
            return Steps(np.zeros((len(from_ns), 3)), _SPEED_M_S * elapsed_s, nothing, nothing > 0)
        start, end = self._at(from_ns), self._at(to_ns)
        is_new = start.frame != end.frame
        moved_m = np.where(is_new[:, None], 0.0, end.p_m - start.p_m)
        unknown_m = _SPEED_M_S * np.minimum(start.gap_s + end.gap_s, elapsed_s)
        length_m = np.where(is_new, 0.0, np.abs(end.length_m - start.length_m))
        return Steps(moved_m, np.where(is_new, _ELSEWHERE_M, unknown_m), length_m, is_new)

    def _stacked(self) -> tuple[Times, Array, Times, Array]:
        if self._arrays is None:
            p_m, frame = np.array(self._p_m).reshape(-1, 3), np.array(self._frame, np.int64)
            legs_m = np.where(frame[1:] == frame[:-1], np.linalg.norm(np.diff(p_m, axis=0), axis=1), 0.0)
            length_m = np.concatenate([[0.0], np.cumsum(legs_m)])
            self._arrays = np.array(self._t_ns, np.int64), p_m, frame, length_m
        return self._arrays

    def _after(self, t_ns: Times) -> npt.NDArray[np.intp]:
        return np.clip(np.searchsorted(self._stacked()[0], t_ns), min(1, len(self._t_ns) - 1), len(self._t_ns) - 1)

    def _at(self, t_ns: Times) -> _Places:
        """Between two places of one frame, straight; elsewhere as at the nearest."""
        times, p_m, frame, length_m = self._stacked()
        after = self._after(t_ns)
        before = np.maximum(after - 1, 0)
        span_ns = np.maximum(times[after] - times[before], 1)
        share = np.clip((t_ns - times[before]) / span_ns, 0.0, 1.0)
        joined = frame[after] == frame[before]
        share = np.where(joined, share, np.rint(share))
        nearest_ns = np.minimum(np.abs(t_ns - times[before]), np.abs(t_ns - times[after]))
        inside = joined & (t_ns >= times[before]) & (t_ns <= times[after]) & (span_ns <= _JOINED_NS)
        place_m = p_m[before] + share[:, None] * (p_m[after] - p_m[before])
        place_m = np.where(joined[:, None], place_m, p_m[np.where(share > 0, after, before)])
        return _Places(
            place_m,
            np.where(share > 0, frame[after], frame[before]),
            np.where(inside, 0.0, nearest_ns * 1e-9),
            length_m[before] + share * (length_m[after] - length_m[before]),
        )
