"""Shares of few trials, with the interval that they leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_Z95: Final = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Share:
    """`count` of `total`, total > 0; `low` and `high` bound the share by Wilson's score interval at 95 % (E. B. Wilson,
    J. Am. Stat. Assoc. 22, 1927), which means something at 0 and at 1 too."""

    count: int
    total: int

    @property
    def value(self) -> float:
        return self.count / self.total

    @property
    def low(self) -> float:
        return max(0.0, self._centre - self._half)

    @property
    def high(self) -> float:
        return min(1.0, self._centre + self._half)

    def __str__(self) -> str:
        """In percent: 93.8 (84.5-97.9)."""
        return f"{100 * self.value:.3g} ({100 * self.low:.3g}-{100 * self.high:.3g})"

    @property
    def _centre(self) -> float:
        return (self.count + _Z95**2 / 2) / (self.total + _Z95**2)

    @property
    def _half(self) -> float:
        spread = self.count * (self.total - self.count) / self.total + _Z95**2 / 4
        return _Z95 * math.sqrt(spread) / (self.total + _Z95**2)
