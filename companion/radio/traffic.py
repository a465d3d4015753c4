"""Bytes per second sent at a network interface, by the kernel's own count."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from companion.core.clock import NS_PER_S

SYSFS = Path("/sys/class/net")


def sent_bytes(interface: str) -> int | None:
    """Since the interface exists; None where there is none of this name."""
    try:
        return int((SYSFS / interface / "statistics" / "tx_bytes").read_text())
    except (OSError, ValueError):
        return None


class Traffic:
    """Rates between one call and the next. Interfaces that are None are left out."""

    def __init__(self, interfaces: Iterable[str | None]) -> None:
        self._last: dict[str, tuple[int, int]] = {}
        self._names = [name for name in interfaces if name is not None]
        self._rates: dict[str, float] = {}

    def bytes_per_s(self, now_ns: int) -> dict[str, float]:
        """Over at least half a second: a call sooner gives the rates of the last one."""
        for name in self._names:
            count = sent_bytes(name)
            if count is None:
                self._rates.pop(name, None)
                continue
            then_ns, before = self._last.get(name, (now_ns, count))
            if now_ns - then_ns >= NS_PER_S // 2:
                self._rates[name] = (count - before) * NS_PER_S / (now_ns - then_ns)
            if now_ns - then_ns >= NS_PER_S // 2 or name not in self._last:
                self._last[name] = now_ns, count
        return dict(self._rates)
