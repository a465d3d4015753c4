"""The vehicle's own clock from ours, by what its messages say of their time.

PX4 takes the stamps of ODOMETRY for its own time once it has listened to TIMESYNC for a while, so poses are stamped in
it. Its TIMESYNC requests, at 10 Hz, tell it to the nanosecond, positions and attitudes to the millisecond; the least
delayed of them is right to within the delay of the link. (Its answers to requests of ours would be right to half a
round trip, but PX4 1.16 leaves their target unset, and MAVSDK drops what is addressed to others.)

The same numbers tell two things that no arrival time can: the vehicle's clock steps back when it restarts, and leaps
ahead of ours when our own clock stood still (a suspended host, a paused virtual machine). Pure.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from typing import Final

_DRIFT: Final = 0.02
"""By which the two clocks' rates may differ: a flight controller's by 1e-5, PX4's simulation by 1.7 %."""
_RESTART_NS: Final = 1_000_000_000
_LEAP_NS: Final = 300_000_000
_LEARN_NS: Final = 1_000_000_000
"""So long after the first message a leap is but a queue that empties."""
_MANY_NS: Final = 5_000_000_000
"""No vehicle starts five times within so long: its clock and another's alternate."""
_WRAP_MS: Final = 1 << 32
"""time_boot_ms has 32 bits: after 49.7 days it begins at 0 again, and TIMESYNC goes on."""
_NEAR_MS: Final = 60_000
"""So near to where the clock should be now, a count that began again is the same boot's."""
_KNOWN_AFTER: Final = 10
"""Messages: one alone may have been held up."""


class Turn(StrEnum):
    """What happened to one of the two clocks."""

    RESTARTED = "restarted"
    """The vehicle's stepped back: it has started anew."""
    LEAPT = "leapt"
    """The vehicle's ran ahead: ours stood still meanwhile."""


class VehicleClock:
    """Not thread-safe."""

    def __init__(self) -> None:
        self.stood_still_ns = 0
        """Of ours, while the vehicle's went on: all leaps since the beginning."""
        self._restarts_ns: deque[int] = deque(maxlen=5)
        """When the last ones were."""
        self._count = 0
        self._told_ns = 0
        self._first_mono_ns = 0
        self._ahead_ns = 0
        """The vehicle's clock minus ours, by the least delayed message: it is ahead by this much or a little more."""
        self._ahead_mono_ns = 0

    @property
    def offset_ns(self) -> int | None:
        """The vehicle's clock minus ours; None while unknown."""
        return self._ahead_ns if self._count >= _KNOWN_AFTER else None

    def at(self, t_mono_ns: int) -> int | None:
        """The vehicle's time at one of ours [ns]."""
        return None if self.offset_ns is None else t_mono_ns + self.offset_ns

    def is_of_two(self, now_ns: int) -> bool:
        """Whether two vehicles tell their clocks under one name."""
        many = self._restarts_ns
        return len(many) == many.maxlen and many[-1] - many[0] < _MANY_NS and now_ns - many[-1] < _MANY_NS

    def unwrapped(self, boot_ms: int, now_ns: int) -> int:
        """A 32-bit `boot_ms` as the vehicle's clock goes on [ms]; as it is where the vehicle has restarted."""
        if not self._count:
            return boot_ms
        expected_ms = (now_ns + self._ahead_ns) // 1_000_000
        whole_ms = boot_ms + max(0, round((expected_ms - boot_ms) / _WRAP_MS)) * _WRAP_MS
        return whole_ms if abs(whole_ms - expected_ms) < _NEAR_MS else boot_ms

    def told(self, vehicle_ns: int, now_ns: int) -> Turn | None:
        """A message that left at `vehicle_ns` by the vehicle's clock arrived."""
        restarted = self._count > 0 and vehicle_ns < self._told_ns - _RESTART_NS
        self._told_ns = vehicle_ns
        if restarted:
            self._restarts_ns.append(now_ns)
        if restarted or not self._count:
            self._count, self._first_mono_ns = 1, now_ns
            self._ahead_ns, self._ahead_mono_ns = vehicle_ns - now_ns, now_ns
            return Turn.RESTARTED if restarted else None
        self._count += 1
        return self._compare(vehicle_ns - now_ns, now_ns)

    def _compare(self, ahead_ns: int, now_ns: int) -> Turn | None:
        """A message counts when it was delayed less than the best one, which is worth the less the older it gets."""
        gain_ns = ahead_ns - self._ahead_ns
        if gain_ns < -_DRIFT * (now_ns - self._ahead_mono_ns):
            return None
        leapt = gain_ns > _LEAP_NS and now_ns - self._first_mono_ns > _LEARN_NS
        if leapt:
            self.stood_still_ns += gain_ns
        self._ahead_ns, self._ahead_mono_ns = ahead_ns, now_ns
        return Turn.LEAPT if leapt else None
