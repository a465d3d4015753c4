"""The NIC's microsecond clock on the host's clock.

A packet reaches the host late by a varying delay, never early. So the relation of the two clocks is the line under all
(NIC time, host time - NIC time) points of a recent window: a lower envelope, with a slope of at most 100 ppm.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import exp, inf
from typing import Final

import numpy as np
import numpy.typing as npt

MAX_SLOPE: Final = 100e-6
"""Two crystals of +-20 ppm each and some margin for a host clock that is being slewed."""
_WRAP_US: Final = 1 << 32
_RESET_NS: Final = 500_000_000
_LATEST_NS: Final = 10_000_000_000
"""A host that stalled finds old records in its socket: late, and still of the same clock."""
_BUCKET_NS: Final = 1_000_000_000
_BUCKETS: Final = 40
"""How far back the envelope reaches. With 120 packets a second, each late by up to 20 ms, the fastest of a second is
late by 0.2 ms, and so far back from it the slope is known to a millionth. Crystals keep their rate that long: 0.01 ppm
a second, as when they warm up, bend the line by 2 us."""
_AGREEING_BUCKETS: Final = 10
_STRAYED_NS: Final = 1_000_000
"""Where the fastest packet of each of so many buckets comes later than the line by this, the clocks have changed their
relation, as when the host's is slewed: what is older says nothing any more."""
_SLOPE_SPAN_NS: Final = 3_000_000_000
_RESOLUTION_NS: Final = 1_000.0
_USUAL_MISFIT: Final = 0.65
"""Median distance of an exponential deviate from the middle of two others, as a share of their mean."""
_STRAIGHT: Final = 1e-3
"""An exponential that rises by less is taken for a straight line."""
_BLOCK: Final = 100
_MAX_LEAD_NS: Final = 1_000_000
_AGREE_WITHIN_NS: Final = 2_000_000_000
_STEP_BLOCK: Final = 20
_STEP_WINDOW_S: Final = 2.0
_STEP_SEEN_S: Final = 0.5
"""How much of a recording must be on either side of a step for it to be told from a late burst."""
_STEP_S: Final = 0.01

Point = tuple[float, float]


class NicClock:
    """Maps each packet's NIC time stamp to the host's monotonic clock. One clock for each NIC.

    Wraps of the 32-bit counter are followed. One packet that seems far too early has a wrong stamp; two that agree show
    that all before were late. A counter that went back, that is half a second ahead of the host, or ten
    seconds behind it has been reset, and the mapping starts over.
    """

    def __init__(self) -> None:
        self._last_stamp_us: int | None = None
        self._last_mono_ns = 0
        self._nic_ns = 0
        self._start_nic_ns = 0
        self._start_offset_ns = 0
        self._minima: deque[tuple[int, Point]] = deque(maxlen=_BUCKETS)
        self._line = (0.0, 0.0)
        self._doubted: Point = (0.0, inf)
        """The newest packet that seems to have come long before the fastest one."""
        self.resets = 0

    def update(self, timestamp_low_us: int, t_mono_ns: int) -> int:
        """Host time [ns] at which the packet was received, never later than `t_mono_ns`, when the host read it."""
        self._follow(timestamp_low_us, t_mono_ns)
        elapsed_ns = self._nic_ns - self._start_nic_ns
        offset_ns = t_mono_ns - self._nic_ns - self._start_offset_ns
        if self._keep(elapsed_ns, float(offset_ns)):
            self._line = envelope([point for _, point in self._minima])
        return min(t_mono_ns, self._nic_ns + self._start_offset_ns + self._correction_ns(elapsed_ns))

    def host_ns(self, timestamp_low_us: npt.NDArray[np.uint32]) -> npt.NDArray[np.int64]:
        """Host times (N,) [ns] of packets received since the newest reset and within half an hour, by the relation as
        it is known now, which is better than it was when each came. Raises ValueError before the first `update`."""
        if self._last_stamp_us is None:
            raise ValueError("no packet has been seen yet")
        # A difference of uint32 wraps as the counter does; read as int32 it is signed.
        since_us = (timestamp_low_us.astype(np.uint32) - np.uint32(self._last_stamp_us)).view(np.int32)
        elapsed_ns = since_us.astype(np.int64) * 1000 + (self._nic_ns - self._start_nic_ns)
        slope, intercept = self._line
        start_ns = self._start_nic_ns + self._start_offset_ns
        return np.asarray(start_ns + elapsed_ns + np.rint(slope * elapsed_ns + intercept).astype(np.int64))

    @property
    def span_s(self) -> float:
        """How long a stretch the relation rests on."""
        if not self._minima:
            return 0.0
        return (self._nic_ns - self._start_nic_ns - self._minima[0][0] * _BUCKET_NS) * 1e-9

    def _correction_ns(self, elapsed_ns: int) -> int:
        slope, intercept = self._line
        return round(slope * elapsed_ns + intercept)

    def _follow(self, stamp_us: int, t_mono_ns: int) -> None:
        if self._last_stamp_us is None:
            self._restart(stamp_us, t_mono_ns)
        else:
            # Signed, so that records that arrive slightly out of order do not count as a wrap.
            step_us = (stamp_us - self._last_stamp_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
            step_ns = step_us * 1000
            late_ns = t_mono_ns - self._start_offset_ns - self._nic_ns - step_ns
            went_back = step_ns < 0 and t_mono_ns - self._last_mono_ns - step_ns > _RESET_NS
            if went_back or not -_RESET_NS < late_ns < _LATEST_NS:
                self.resets += 1
                self._restart(stamp_us, t_mono_ns)
            else:
                self._nic_ns += step_ns
        self._last_stamp_us, self._last_mono_ns = stamp_us, t_mono_ns

    def _restart(self, stamp_us: int, t_mono_ns: int) -> None:
        self._nic_ns = self._start_nic_ns = stamp_us * 1000
        self._start_offset_ns = t_mono_ns - self._nic_ns
        self._minima.clear()
        self._doubted = (0.0, inf)

    def _keep(self, elapsed_ns: int, offset_ns: float) -> bool:
        """Whether the packet is one of those that the line rests on."""
        if self._minima and self._is_doubtful(elapsed_ns, offset_ns):
            return False
        bucket = elapsed_ns // _BUCKET_NS
        point = (float(elapsed_ns), offset_ns)
        if not self._minima or bucket > self._minima[-1][0]:
            self._forget_strayed()
            self._minima.append((bucket, point))
            return True
        if offset_ns < self._minima[-1][1][1]:
            self._minima[-1] = (bucket, point)
            return True
        return False

    def _forget_strayed(self) -> None:
        newest = list(self._minima)[-_AGREEING_BUCKETS:]
        slope, intercept = self._line
        if len(newest) == _AGREEING_BUCKETS and all(y - slope * t - intercept > _STRAYED_NS for _, (t, y) in newest):
            self._minima = deque(newest, maxlen=_BUCKETS)

    def _is_doubtful(self, elapsed_ns: int, offset_ns: float) -> bool:
        if self._correction_ns(elapsed_ns) - offset_ns <= _MAX_LEAD_NS:
            return False
        then_ns, doubted_ns = self._doubted
        agrees = abs(offset_ns - doubted_ns) <= _MAX_LEAD_NS and abs(elapsed_ns - then_ns) <= _AGREE_WITHIN_NS
        self._doubted = float(elapsed_ns), offset_ns
        return not agrees


def envelope(points: list[Point]) -> tuple[float, float]:
    """(slope, intercept) of the line under all points, |slope| <= 100 ppm; ns in, sorted by time.

    Delays just above the least come evenly, so of all lines under the points one is the likelier the less room it
    leaves: by exp(-room / r), with r how late a point is in the mean. The line is the mean of all of them. The
    likeliest alone has its slope from two neighbours of the lower hull, and errs up to three times as much at its end,
    where it is used. A short span says nothing about a slope: there it is zero.
    """
    if points[-1][0] - points[0][0] < _SLOPE_SPAN_NS:
        return 0.0, min(y for _, y in points)
    middle = sum(t for t, _ in points) / len(points)
    least = min(y for _, y in points)
    hull = [(t - middle, y - least) for t, y in _lower_hull(points)]
    bends = [_limited((y1 - y0) / (t1 - t0)) for (t0, y0), (t1, y1) in pairwise(hull)]
    rate = len(points) / _room(points)
    # While the slope is between two bends, the line that leaves least room touches the hull in the point between them;
    # over each such stretch the weight is an exponential of the slope, and its moments have a closed form.
    stretches = [
        (t, y, low, high)
        for (t, y), low, high in zip(hull, [-MAX_SLOPE, *bends], [*bends, MAX_SLOPE], strict=True)
        if low < high
    ]
    highest = max(y - slope * t for t, y, low, high in stretches for slope in (low, high))
    total = slopes = levels = 0.0
    for t, y, low, high in stretches:
        at_low, at_high = (rate * (y - slope * t - highest) for slope in (low, high))
        weight, first = _moments(at_low, at_high)
        weight, first = weight * (high - low), first * (high - low) ** 2 + weight * (high - low) * low
        total, slopes, levels = total + weight, slopes + first, levels + y * weight - t * first
    slope = slopes / total
    return slope, levels / total + least - slope * middle


def _limited(slope: float) -> float:
    return min(MAX_SLOPE, max(-MAX_SLOPE, slope))


def _room(points: list[Point]) -> float:
    """How late a point is in the mean [ns], from the median of how far each lies off the line between its neighbours,
    so that clocks whose rate changes do not pass for late points. At least what stamps tell apart."""
    off = sorted(
        abs(y - (y0 * (t1 - t) + y1 * (t - t0)) / (t1 - t0))
        for (t0, y0), (t, y), (t1, y1) in zip(points, points[1:], points[2:], strict=False)
        if t1 > t0
    )
    return max(_RESOLUTION_NS, off[len(off) // 2] / _USUAL_MISFIT if off else 0.0)


def _moments(at_0: float, at_1: float) -> tuple[float, float]:
    """Integrals over x from 0 to 1 of exp(f) and x exp(f), where f goes straight from `at_0` to `at_1`."""
    rise, low, high = at_1 - at_0, exp(at_0), exp(at_1)
    if abs(rise) < _STRAIGHT:
        return (low + high) / 2.0, (low + 2.0 * high) / 6.0
    return (high - low) / rise, (rise * high - high + low) / rise**2


def host_times_s(
    timestamp_low_us: npt.NDArray[np.uint32], host_time_s: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """A recording's packet times (N,) [s] on the host's wall clock, freed of the delay jitter; see NicClock.

    Uses the whole recording at once: the envelope of each stretch between resets of the NIC's clock. A single wrong
    stamp of either clock moves no other packet. Where the host's time is nan the result is nan.
    """
    result = np.full(len(host_time_s), np.nan)
    if not len(result):
        return result
    # A difference of uint32 wraps as the counter does; read as int32 it is signed.
    steps_us = np.diff(timestamp_low_us.astype(np.uint32)).view(np.int32).astype(np.int64)
    offset_s = host_time_s - host_time_s[0] - np.concatenate([[0], np.cumsum(steps_us)]) * 1e-6
    resets = np.flatnonzero(np.abs(np.diff(median_of_five(offset_s))) > _RESET_NS * 1e-9) + 1
    for stretch in np.split(np.arange(len(host_time_s)), resets):
        if len(stretch) and np.all(np.isfinite(host_time_s[stretch])):
            nic_us = np.concatenate([[0], np.cumsum(steps_us[stretch[:-1]])])
            result[stretch] = _mapped_s(nic_us * 1e-6, host_time_s[stretch])
    return result


def host_step(
    timestamp_low_us: npt.NDArray[np.uint32], host_time_s: npt.NDArray[np.float64]
) -> tuple[int, float] | None:
    """Where the host's clock was first set within a recording, and by how many seconds: (number of the first record
    behind it, to about twenty; step). None where it was not, or by less than 10 ms.

    Delays only ever add, and some packets are fast, so the least (host - NIC) of two seconds is a level that stays. A
    host that stalls raises it for as long as the stall; a clock that was set moves it for good. A slewed clock moves it
    by less. The NIC's own resets are taken out.
    """
    if not np.all(np.isfinite(host_time_s)):
        return None
    host_steps_s = np.diff(host_time_s)
    nic_steps_s = np.diff(timestamp_low_us.astype(np.uint32)).view(np.int32).astype(np.float64) * 1e-6
    # Packets that come close behind each other by the NIC's clock did; what else differs is a reset or another session.
    close = (nic_steps_s > -_RESET_NS * 1e-9) & (nic_steps_s < _STEP_WINDOW_S)
    resets = np.flatnonzero((np.abs(host_steps_s - nic_steps_s) > _RESET_NS * 1e-9) & ~close) + 1
    for stretch in np.split(np.arange(len(host_time_s)), resets):
        nic_s = np.concatenate([[0.0], np.cumsum(nic_steps_s[stretch[:-1]])])
        found = _step_within(nic_s, host_time_s[stretch] - host_time_s[stretch[:1]] - nic_s)
        if found is not None:
            return int(stretch[0]) + found[0], found[1]
    return None


def _step_within(nic_s: npt.NDArray[np.float64], offset_s: npt.NDArray[np.float64]) -> tuple[int, float] | None:
    if len(offset_s) < 2 * _STEP_BLOCK:
        return None
    blocks = np.array_split(np.arange(len(offset_s)), len(offset_s) // _STEP_BLOCK)
    # The third least: a single wrong stamp is no level.
    levels_s = np.array([np.partition(offset_s[block], 2)[2] for block in blocks])
    begins_s = np.array([nic_s[block].min() for block in blocks])
    for at in range(1, len(blocks)):
        before = np.flatnonzero(begins_s[:at] >= begins_s[at] - _STEP_WINDOW_S)
        after = at + np.flatnonzero(begins_s[at:] < begins_s[at] + _STEP_WINDOW_S)
        if min(begins_s[at] - begins_s[0], begins_s[-1] - begins_s[at]) < _STEP_SEEN_S or not len(before):
            continue
        step_s = float(levels_s[after].min() - levels_s[before].min())
        if abs(step_s) > _STEP_S:
            return int(blocks[at][0]), step_s
    return None


def _mapped_s(nic_s: npt.NDArray[np.float64], host_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    offset_ns = (host_s - host_s[0] - nic_s) * 1e9
    order = np.argsort(nic_s, kind="stable")
    order = order[_plausible(offset_ns[order])]
    points = list(zip((nic_s[order] * 1e9).tolist(), offset_ns[order].tolist(), strict=True))
    slope, intercept_ns = envelope(points)
    mapped: npt.NDArray[np.float64] = host_s[0] + nic_s * (1 + slope) + intercept_ns * 1e-9
    return mapped


def median_of_five(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Keeps steps where they are and removes what is wrong in at most two values in a row."""
    padded = np.pad(values, 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1))


def _plausible(offset_ns: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """False where a packet seems to have come long before the fastest of those around it: one of its stamps is wrong.

    Fast packets are common, so that the fastest twentieth of a block lies close together.
    """
    floors = [
        np.full(len(block), np.sort(block)[min(len(block) - 1, max(1, len(block) // 20))])
        for block in np.array_split(offset_ns, max(1, len(offset_ns) // _BLOCK))
    ]
    return np.asarray(offset_ns >= np.concatenate(floors) - _MAX_LEAD_NS)


def _lower_hull(points: list[Point]) -> list[Point]:
    hull: list[Point] = []
    for t, y in points:
        if hull and t == hull[-1][0]:
            if y >= hull[-1][1]:
                continue
            hull.pop()
        while len(hull) >= 2 and _above(hull[-2], hull[-1], (t, y)):
            hull.pop()
        hull.append((t, y))
    return hull


def _above(first: Point, middle: Point, last: Point) -> bool:
    return (middle[1] - first[1]) * (last[0] - first[0]) >= (last[1] - first[1]) * (middle[0] - first[0])
