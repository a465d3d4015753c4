"""Whether an authentic datagram is new: replays, reboots, and two robots that claim one identity. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.inputs import Reached

_WINDOW: Final = 64
_RIVALRY_NS: Final = 10 * NS_PER_S
_ALTERNATIONS: Final = 3
_KEPT_BOOTS: Final = 8


class Freshness(StrEnum):
    FRESH = "fresh"
    REPLAY = "replay"
    DUPLICATE = "duplicate identity"


class ReplayWindow:
    """Which of the newest 64 counters were seen: each is fresh once, older ones never (as in IPsec, RFC 4303 3.4.3)."""

    def __init__(self, floor: int = -1) -> None:
        self.highest = floor
        self._seen = (1 << _WINDOW) - 1

    def is_fresh(self, counter: int) -> bool:
        behind = self.highest - counter
        return behind < 0 or (behind < _WINDOW and not self._seen >> behind & 1)

    def mark(self, counter: int) -> None:
        ahead = counter - self.highest
        if ahead > 0:
            self._seen = (self._seen << min(ahead, _WINDOW) | 1) & (1 << _WINDOW) - 1
            self.highest = counter
        else:
            self._seen |= 1 << -ahead


@dataclass(slots=True)
class _Boot:
    window: ReplayWindow
    heard_ns: int


class SenderSession:
    """Judges the datagrams of one sender, which are authentic already.

    A higher boot number is a reboot and replaces the one before. Older boots are replays; but one that was heard live
    before, or that has the number of the present one, and goes on with counters never seen, in turn with the present
    one, is a second robot with the same key and name. Then both are refused until only one has been heard for ten
    seconds.
    """

    def __init__(self, reached: Reached | None) -> None:
        self._reached = reached
        self._current: int | None = None
        self._boots: dict[int, _Boot] = {}
        self._alternations = 0
        self._newest: int | None = None
        self._rivalry_ns: int | None = None
        self.rivals: tuple[int, int] | None = None
        """The boot ids that interleave, while they do."""
        self.old_boots = 0
        """Datagrams of boots that nobody heard, with numbers that were passed already: replays, or a robot that has
        lost its count."""

    @property
    def boot_id(self) -> int | None:
        return self._current

    def judge(self, boot_id: int, counter: int, now_ns: int) -> Freshness:
        if self._current is None:
            return self._first(boot_id, counter, now_ns)
        if boot_id != self._current and _number(boot_id) > _number(self._current):
            self._enter(boot_id, counter, now_ns, -1)
            return self._unless_rivals(boot_id, now_ns, is_reboot=True)
        boot = self._boots.get(boot_id)
        if boot is None:
            if _number(boot_id) < _number(self._current):
                return self._old()
            # The same number with another random part: only a copy of the same state can have made it.
            boot = self._boots[boot_id] = _Boot(ReplayWindow(counter - 1), now_ns)
        if not boot.window.is_fresh(counter):
            return Freshness.REPLAY
        boot.window.mark(counter)
        boot.heard_ns = now_ns
        verdict = self._unless_rivals(boot_id, now_ns)
        if verdict is Freshness.FRESH and boot_id != self._current:
            return Freshness.REPLAY
        return verdict

    def _first(self, boot_id: int, counter: int, now_ns: int) -> Freshness:
        reached = self._reached
        floor = -1
        if reached is not None:
            if boot_id == reached.boot_id:
                floor = reached.ceiling
            elif _number(boot_id) <= _number(reached.boot_id):
                return self._old()
        if counter <= floor:
            return Freshness.REPLAY
        self._enter(boot_id, counter, now_ns, floor)
        self._newest = boot_id
        return Freshness.FRESH

    def _old(self) -> Freshness:
        self.old_boots += 1
        return Freshness.REPLAY

    def _enter(self, boot_id: int, counter: int, now_ns: int, floor: int) -> None:
        self._current = boot_id
        self._boots[boot_id] = _Boot(ReplayWindow(floor), now_ns)
        self._boots[boot_id].window.mark(counter)
        while len(self._boots) > _KEPT_BOOTS:
            self._boots.pop(next(iter(self._boots)))

    def _unless_rivals(self, boot_id: int, now_ns: int, is_reboot: bool = False) -> Freshness:
        """Counts how often fresh datagrams of different boots take turns; a robot that starts again and again comes
        back to none."""
        if self._rivalry_ns is not None and now_ns - self._rivalry_ns > _RIVALRY_NS:
            self._rivalry_ns, self.rivals, self._alternations = None, None, 0
        if self._newest is not None and boot_id != self._newest and not is_reboot:
            recent = self._boots.get(self._newest)
            live = recent is not None and now_ns - recent.heard_ns <= _RIVALRY_NS
            self._alternations = self._alternations + 1 if live else 0
            if self._alternations >= _ALTERNATIONS:
                self.rivals = min(boot_id, self._newest), max(boot_id, self._newest)
                self._rivalry_ns = now_ns
        self._newest = boot_id
        return Freshness.DUPLICATE if self.rivals is not None else Freshness.FRESH


def _number(boot_id: int) -> int:
    return boot_id >> 32
