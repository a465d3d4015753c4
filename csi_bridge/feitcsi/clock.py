"""Both clocks of the card, unwrapped: microseconds, and the fine one of 3.125 ns that wraps every 13.4 s."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.feitcsi.records import TICKS_PER_US

_TICKS_WRAP: Final = 1 << 32


def unwrapped_us(stamps_us: npt.NDArray[np.uint32]) -> npt.NDArray[np.int64]:
    """Microseconds (N,) from the first stamp's value on, through wraps of 32 bits; some records may be out of order."""
    stamps = np.asarray(stamps_us, np.uint32)
    # A difference of uint32 wraps as the counter does; read as int32 it is signed.
    steps = np.diff(stamps).view(np.int32).astype(np.int64)
    return np.concatenate([stamps[:1].astype(np.int64), stamps[:1].astype(np.int64) + np.cumsum(steps)])


def fine_us(ftm_ticks: npt.NDArray[np.uint32], stamps_us: npt.NDArray[np.uint32]) -> npt.NDArray[np.float64]:
    """Reception times (N,) [us] to 3.125 ns, on the microsecond clock to its own microsecond at the first record.

    Between two records the microseconds say how often the fine clock wrapped, however long that was.
    """
    coarse = unwrapped_us(stamps_us)
    if not len(coarse):
        return np.zeros(0)
    expected = np.diff(coarse) * TICKS_PER_US
    steps = np.diff(np.asarray(ftm_ticks, np.uint32).astype(np.int64))
    steps += (expected - steps + _TICKS_WRAP // 2) // _TICKS_WRAP * _TICKS_WRAP
    return np.asarray(coarse[0] + np.concatenate([[0], np.cumsum(steps)]) / TICKS_PER_US)
