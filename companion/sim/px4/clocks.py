"""The mock's own clock, and its view of the companion's: how TIMESYNC answers make stamps of ODOMETRY its own time."""

from __future__ import annotations

from typing import Final

CONVERGED_AFTER: Final = 500
"""Answers; 50 s at PX4's ten requests a second."""
_LONGEST_ROUND_TRIP_NS: Final = 10_000_000
_FARTHEST_NS: Final = 100_000_000
_FAR_ALLOWED: Final = 10


class PowerUpClock:
    """Time since power-up, by an oscillator of its own: nothing relates it to the host's monotonic clock."""

    def __init__(self, now_ns: int, up_s: float = 0.0, rate: float = 1.0) -> None:
        """`up_s` is what it shows now, `rate` how fast it goes against the host's clock."""
        self._start_ns, self._up_ns, self._rate = now_ns, round(up_s * 1e9), rate

    def ns(self, now_ns: int) -> int:
        return self._up_ns + round((now_ns - self._start_ns) * self._rate)

    def boot(self, now_ns: int) -> None:
        self._start_ns, self._up_ns = now_ns, 0


class ClockFilter:
    """Before it has converged a message's time is that of its arrival, without a word; afterwards the stamp counts.

    The gain is what PX4's two-gain filter comes to where the clocks' rates agree.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.offset_ns = 0.0
        """Our time minus the companion's."""
        self._far = 0

    @property
    def has_converged(self) -> bool:
        return self.samples >= CONVERGED_AFTER

    def answer(self, now_ns: int, theirs_ns: int, asked_ns: int) -> None:
        """An answer `theirs_ns` to the request that went out at `asked_ns` arrived."""
        offset_ns = (asked_ns + now_ns - 2 * theirs_ns) / 2
        if not 0 <= now_ns - asked_ns < _LONGEST_ROUND_TRIP_NS:
            return
        if self.has_converged and abs(offset_ns - self.offset_ns) > _FARTHEST_NS:
            self._far += 1
            if self._far > _FAR_ALLOWED:
                self.__init__()  # type: ignore[misc]
            return
        gain = 1.0 if not self.samples else 0.003 if self.has_converged else 0.05
        self.offset_ns += gain * (offset_ns - self.offset_ns)
        self.samples += 1
        self._far = 0

    def own_time_ns(self, now_ns: int, stamp_ns: int) -> int:
        """What the estimator takes a message stamped `stamp_ns` by the companion to be of."""
        return stamp_ns + round(self.offset_ns) if self.has_converged else now_ns
