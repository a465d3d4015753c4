"""All batteries of a vehicle as one figure: the lowest of those that tell something, and who tells nothing. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_FRESH_NS: Final = 5_000_000_000
"""BATTERY_STATUS is asked for at 1 Hz and comes by itself every 2 s."""


@dataclass(frozen=True, slots=True)
class Charge:
    """What the batteries come to now."""

    remaining: float | None
    """0..1, the lowest of all that are fresh and known; None when there is none."""
    mono_ns: int | None
    """When that was told; without it when the newest of any battery came."""
    unknown: tuple[int, ...]
    """Ids of those that were heard once and are old now, or do not know how full they are."""


class Batteries:
    """The newest of each id."""

    def __init__(self) -> None:
        self._told: dict[int, tuple[float | None, int]] = {}

    def take(self, battery_id: int, remaining: float | None, now_ns: int) -> None:
        self._told[battery_id] = remaining, now_ns

    def now(self, now_ns: int) -> Charge:
        lowest: tuple[float, int] | None = None
        unknown = []
        for battery_id, (remaining, t_ns) in self._told.items():
            if remaining is None or now_ns - t_ns >= _FRESH_NS:
                unknown.append(battery_id)
            elif lowest is None or (remaining, t_ns) < lowest:
                lowest = remaining, t_ns
        unknown.sort()
        if lowest is not None:
            return Charge(*lowest, tuple(unknown))
        return Charge(None, max((t_ns for _, t_ns in self._told.values()), default=None), tuple(unknown))
