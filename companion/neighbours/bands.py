"""Which subcarriers the channels of a datagram are of: one number, which stands for a format and a width.

0 is an Intel 5300 over 20 MHz. Others are the `layout` of the rate word of an AX card, its bits 8 to 13, whose channels
are thinned as `csi_bridge.feitcsi.channel.thinned` does.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from csi_bridge.feitcsi.channel import thinned_hz
from csi_bridge.feitcsi.rate import Rate
from csi_bridge.feitcsi.tones import tones_of
from wsr.ofdm import GRID_5300, Grid, grid
from wsr.reduced import coefficients

OF_5300: Final = 0
_SHIFT: Final = 8
_BITS: Final = 0x3F


@lru_cache(maxsize=64)
def grid_of(band: int) -> Grid:
    """Raises ValueError for a number that stands for nothing."""
    if band == OF_5300:
        return GRID_5300
    plan = tones_of(band << _SHIFT) if 0 < band <= _BITS else None
    if plan is None:
        raise ValueError(f"band {band} is none that a card reports")
    return grid(thinned_hz(plan))


def coefficients_of(band: int) -> int:
    """How many a channel is sent as. Raises ValueError as `grid_of`."""
    return coefficients(grid_of(band))


def name_of(band: int) -> str:
    return "20 MHz of a 5300" if band == OF_5300 else str(Rate(band << _SHIFT))
