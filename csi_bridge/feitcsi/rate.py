"""The rate word of a report (bits of iwlwifi's rate_n_flags, version 2): what was received, and how wide."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

_WIDTHS_MHZ: Final = (20, 40, 80, 160, 320)
_FORMAT_SHIFT, _WIDTH_SHIFT, _THREE_BITS, _SIX_BITS = 8, 11, 7, 63
_ANTENNA_SHIFT: Final = 14


class Format(IntEnum):
    """Modulation, as the word numbers it."""

    CCK = 0
    OFDM = 1
    HT = 2
    VHT = 3
    HE = 4
    EHT = 5


@dataclass(frozen=True, slots=True)
class Rate:
    """Bits 0-3 index, 8-10 format, 11-13 width, 14-15 receive chains, 16 LDPC. Others are kept and not explained."""

    word: int

    @property
    def index(self) -> int:
        """Modulation and coding, as the format counts them."""
        return self.word & 0xF

    @property
    def format(self) -> Format | None:
        """None for a number that no standard has yet."""
        number = self.word >> _FORMAT_SHIFT & _THREE_BITS
        return Format(number) if number <= Format.EHT else None

    @property
    def width_mhz(self) -> int | None:
        number = self.word >> _WIDTH_SHIFT & _THREE_BITS
        return _WIDTHS_MHZ[number] if number < len(_WIDTHS_MHZ) else None

    @property
    def antennas(self) -> tuple[int, ...]:
        """Chains that received: 0 is A, 1 is B."""
        return tuple(chain for chain in (0, 1) if self.word >> (_ANTENNA_SHIFT + chain) & 1)

    @property
    def layout(self) -> int:
        """Format and width as one number, the width above: which subcarriers there are."""
        return self.word >> _FORMAT_SHIFT & _SIX_BITS

    def __str__(self) -> str:
        name = "unknown format" if self.format is None else self.format.name
        return name if self.width_mhz is None else f"{name} {self.width_mhz} MHz"
