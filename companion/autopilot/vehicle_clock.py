"""The vehicle's own clock from ours: by TIMESYNC exchanges that we begin, and by what its messages say of the time.

PX4 takes the stamps of ODOMETRY for its own time once it has listened to TIMESYNC for a while, so poses are stamped in
it. An exchange says where its clock stands to within half its round trip; it is worth the less the older it gets. The
same numbers tell two things that no arrival time can: the vehicle's clock steps back when it restarts, and leaps ahead
of ours when our own clock stood still (a suspended host, a paused virtual machine). Pure.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from typing import Final

_LONGEST_ROUND_TRIP_NS: Final = 1_000_000_000
_DRIFT: Final = 0.02
"""By which the two clocks' rates may differ: a flight controller's by 1e-5, PX4's simulation by 1.7 %."""
_RESTART_NS: Final = 1_000_000_000
_LEAP_NS: Final = 300_000_000
_LEARN_NS: Final = 1_000_000_000
"""So long after the first message a leap is but a queue that empties."""
_REQUESTS_KEPT: Final = 32


class Turn(StrEnum):
    """What happened to one of the two clocks."""

    RESTARTED = "restarted"
    """The vehicle's stepped back: it has started anew."""
    LEAPT = "leapt"
    """The vehicle's ran ahead: ours stood still meanwhile."""


class VehicleClock:
    """Not thread-safe. `offset_ns` is the vehicle's clock minus ours, None while unknown."""

    def __init__(self) -> None:
        self.stood_still_ns = 0
        """Of ours, while the vehicle's went on: all leaps since the beginning."""
        self._asked: deque[int] = deque(maxlen=_REQUESTS_KEPT)
        self._forget()

    def _forget(self) -> None:
        self.offset_ns: int | None = None
        self._bound_ns = 0.0
        self._offset_mono_ns = 0
        self._told_ns: int | None = None
        self._first_mono_ns = 0
        self._ahead_ns = 0.0
        self._ahead_mono_ns = 0

    def at(self, t_mono_ns: int) -> int | None:
        """The vehicle's time at one of ours [ns]."""
        return None if self.offset_ns is None else t_mono_ns + self.offset_ns

    def request(self, now_ns: int) -> int:
        """Begins an exchange: what TIMESYNC.ts1 is to carry."""
        self._asked.append(now_ns)
        return now_ns

    def answer(self, vehicle_ns: int, asked_ns: int, now_ns: int) -> bool:
        """TIMESYNC with tc1 and ts1 arrived. False for one that answers somebody else, or took too long."""
        if asked_ns not in self._asked or not 0 <= now_ns - asked_ns < _LONGEST_ROUND_TRIP_NS:
            return False
        bound_ns = (now_ns - asked_ns) / 2
        if self.offset_ns is None or bound_ns <= self._bound_at(now_ns):
            self.offset_ns = vehicle_ns - (asked_ns + now_ns) // 2
            self._bound_ns, self._offset_mono_ns = bound_ns, now_ns
        return True

    def told(self, vehicle_ns: int, now_ns: int) -> Turn | None:
        """A message that left at `vehicle_ns` by the vehicle's clock arrived. To be called before `answer`."""
        before_ns, self._told_ns = self._told_ns, vehicle_ns
        if before_ns is not None and vehicle_ns < before_ns - _RESTART_NS:
            self._forget()
            self._begin(vehicle_ns, now_ns)
            return Turn.RESTARTED
        if before_ns is None:
            self._begin(vehicle_ns, now_ns)
            return None
        return self._compare(vehicle_ns - now_ns, now_ns)

    def _begin(self, vehicle_ns: int, now_ns: int) -> None:
        self._told_ns, self._first_mono_ns = vehicle_ns, now_ns
        self._ahead_ns, self._ahead_mono_ns = float(vehicle_ns - now_ns), now_ns

    def _compare(self, ahead_ns: int, now_ns: int) -> Turn | None:
        """The least delayed message so far bounds how far the vehicle's clock can be ahead."""
        leap_ns = ahead_ns - self._ahead_ns - _DRIFT * (now_ns - self._ahead_mono_ns)
        if leap_ns <= 0:
            return None
        leapt = leap_ns > _LEAP_NS and now_ns - self._first_mono_ns > _LEARN_NS
        if leapt:
            self.stood_still_ns += round(leap_ns)
            self.offset_ns = None
        self._ahead_ns, self._ahead_mono_ns = float(ahead_ns), now_ns
        return Turn.LEAPT if leapt else None

    def _bound_at(self, now_ns: int) -> float:
        return self._bound_ns + _DRIFT * (now_ns - self._offset_mono_ns)
