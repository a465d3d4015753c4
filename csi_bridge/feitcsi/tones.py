"""Where the subcarriers of a report lie, which of them are pilots, and what the sender turned.

Indices are those of IEEE 802.11 (17.3.5.10 OFDM, 19.3.11 HT, 21.3.10 VHT, 27.3.11 HE) with its spacings, 312.5 kHz and
for HE 78.125 kHz; they agree with the captures: pilots are zero there, and phases go on evenly over the gap at 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.feitcsi.rate import Format, Rate

SPACING_HZ: Final = 312_500.0
HE_SPACING_HZ: Final = 78_125.0
_HOLLOW_HZ: Final = 60e6
_HOLLOW_REACH: Final = 2
"""At 160 MHz the firmware lets the channel fade to an eighth, over five subcarriers, 60 MHz to either side."""

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Tones:
    """One plan: arrays (S,) in the order of a report, lowest frequency first."""

    index: Indices
    spacing_hz: float
    valid: npt.NDArray[np.bool_]
    """False for pilots and for the hollows of 160 MHz: nothing was measured there."""
    turn: npt.NDArray[np.complex64]
    """What the sender multiplied with, of 1, -1, j (802.11's gamma): HT and VHT wider than 20 MHz."""

    @property
    def frequency_hz(self) -> npt.NDArray[np.float64]:
        """From the channel's centre."""
        return np.asarray(self.index * self.spacing_hz, np.float64)


def _both(*ranges: tuple[int, int]) -> Indices:
    """Indices first..last of each range, and the same below zero."""
    upper = np.concatenate([np.arange(first, last + 1) for first, last in ranges])
    return np.concatenate([-upper[::-1], upper])


_PLANS: Final[dict[tuple[Format, int], tuple[tuple[tuple[int, int], ...], tuple[int, ...]]]] = {
    (Format.OFDM, 20): (((1, 26),), (7, 21)),
    (Format.HT, 20): (((1, 28),), (7, 21)),
    (Format.HT, 40): (((2, 58),), (11, 25, 53)),
    (Format.VHT, 80): (((2, 122),), (11, 39, 75, 103)),
    (Format.VHT, 160): (((6, 126), (130, 250)), (25, 53, 89, 117, 139, 167, 203, 231)),
    (Format.HE, 20): (((2, 122),), (22, 48, 90, 116)),
    (Format.HE, 40): (((3, 244),), (10, 36, 78, 104, 144, 170, 212, 238)),
    (Format.HE, 80): (((3, 500),), (24, 92, 158, 226, 266, 334, 400, 468)),
    (Format.HE, 160): (
        ((12, 509), (515, 1012)),
        (44, 112, 178, 246, 286, 354, 420, 488, 536, 604, 670, 738, 778, 846, 912, 980),
    ),
}
"""Ranges of positive indices and pilots among them; all plans are even."""
_SAME_AS: Final = {(Format.VHT, 20): (Format.HT, 20), (Format.VHT, 40): (Format.HT, 40)}


@lru_cache(maxsize=32)
def tones(kind: Format, width_mhz: int) -> Tones | None:
    """The plan of a format and width; None where it is not known how a report of them is laid out."""
    ranges_pilots = _PLANS.get(_SAME_AS.get((kind, width_mhz), (kind, width_mhz)))
    if ranges_pilots is None:
        return None
    ranges, pilots = ranges_pilots
    index = _both(*ranges)
    spacing_hz = HE_SPACING_HZ if kind == Format.HE else SPACING_HZ
    valid = ~np.isin(np.abs(index), pilots)
    if width_mhz == 160:
        valid &= np.abs(np.abs(index) - round(_HOLLOW_HZ / spacing_hz)) > _HOLLOW_REACH
    for array in (index, valid, turn := _turn(kind, width_mhz, index)):
        array.flags.writeable = False
    return Tones(index, spacing_hz, valid, turn)


@lru_cache(maxsize=256)
def tones_of(word: int) -> Tones | None:
    """The plan of a rate word; None as in `tones`."""
    rate = Rate(word)
    return None if rate.format is None or rate.width_mhz is None else tones(rate.format, rate.width_mhz)


def _turn(kind: Format, width_mhz: int, index: Indices) -> npt.NDArray[np.complex64]:
    """802.11's gamma, which the training symbols of HT and VHT carry and those of HE do not."""
    turn = np.ones(len(index), np.complex64)
    if kind not in (Format.HT, Format.VHT):
        return turn
    if width_mhz == 40:
        turn[index > 0] = 1j
    elif width_mhz == 80:
        turn[index >= -64] = -1
    elif width_mhz == 160:
        turn[((index >= -192) & (index < 0)) | (index >= 64)] = -1
    return turn


SUBCARRIERS: Final = tuple(sorted({len(plan.index) for key in _PLANS if (plan := tones(*key)) is not None}))
"""Every number of subcarriers that a report can have."""
