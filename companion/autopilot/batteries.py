"""All batteries of a vehicle as one figure: the lowest of those that tell something, and who tells nothing. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.core.clock import age_s

FRESH_S: Final = 5.0
"""BATTERY_STATUS is asked for at 1 Hz and comes by itself every 2 s."""


@dataclass(frozen=True, slots=True)
class Charge:
    """What the batteries come to now."""

    remaining: float | None
    """0..1, the lowest that any has told last; None when none tells it now. One that falls silent does not raise it."""
    mono_ns: int | None
    """When that was told; without it when the newest of any battery came."""
    unknown: tuple[int, ...]
    """Ids of those that were heard once and are old now, or do not know how full they are."""


@dataclass(frozen=True, slots=True)
class _Told:
    """By one battery: the last charge it knew, when that or later it was heard, and whether it still knows it."""

    remaining: float | None
    mono_ns: int
    is_known: bool


class Batteries:
    """The newest of each id."""

    def __init__(self) -> None:
        self._told: dict[int, _Told] = {}

    def take(self, battery_id: int, remaining: float | None, now_ns: int) -> None:
        before = self._told.get(battery_id)
        last = before.remaining if remaining is None and before is not None else remaining
        self._told[battery_id] = _Told(last, now_ns, remaining is not None)

    def now(self, now_ns: int) -> Charge:
        known = {one for one, told in self._told.items() if told.is_known and age_s(told.mono_ns, now_ns) < FRESH_S}
        unknown = tuple(sorted(self._told.keys() - known))
        lowest = [(told.remaining, told.mono_ns) for told in self._told.values() if told.remaining is not None]
        if known and lowest:
            return Charge(*min(lowest), unknown)
        return Charge(None, max((told.mono_ns for told in self._told.values()), default=None), unknown)
