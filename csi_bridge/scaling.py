"""Power in absolute units, and the spatial mapping of the sender taken out.

The card scales each report to its 8 bits; the power is in rssi and agc. Formulae and matrices are those of the 802.11n
CSI Tool's get_total_rss.m and remove_sm.m (D. Halperin).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

HT_FLAG: Final = 1 << 8
HT40_FLAG: Final = 1 << 11
"""Bits of the rate field (rate_n_flags of iwlwifi)."""
_RSSI_OFFSET_DB: Final = 44
_SPACING_HZ: Final = 312_500.0
_INDICES_20MHZ: Final = (*range(-28, 0, 2), -1, *range(1, 28, 2), 28)
_INDICES_40MHZ: Final = tuple(range(-58, 59, 4))

Complex = npt.NDArray[np.complex64]


def is_40mhz(rate: int) -> bool:
    """The one rule on such records, in flight and in recordings: they are counted and left out, because estimates are
    made from the subcarriers of 20 MHz."""
    return bool(rate & HT40_FLAG)


def are_40mhz(rates: npt.NDArray[np.uint16]) -> npt.NDArray[np.bool_]:
    """`is_40mhz` of each (N,)."""
    return np.asarray(rates & HT40_FLAG != 0)


def subcarrier_hz(rate: int) -> npt.NDArray[np.float64]:
    """Frequencies (30,) of the subcarriers in a report at this rate, from the channel's centre."""
    return np.array(_INDICES_40MHZ if is_40mhz(rate) else _INDICES_20MHZ, np.float64) * _SPACING_HZ


@lru_cache(maxsize=4096)
def total_rss_dbm(rssi: tuple[int, int, int], agc: int) -> float:
    """Received power over all antennas [dBm]; -inf where no antenna reports any. rssi 0 marks an absent antenna."""
    total = sum(10 ** (value / 10) for value in rssi if value)
    return 10 * float(np.log10(total)) - _RSSI_OFFSET_DB - agc if total else -np.inf


def without_spatial_mapping(csi: Complex, rate: int) -> Complex:
    """CSI (..., n_rx, n_tx) per transmit antenna, where the sender mixed its streams over them: HT rates of two or
    three streams. Anything else is returned as it is."""
    n_tx = csi.shape[-1]
    if n_tx == 1 or not rate & HT_FLAG:
        return csi
    return np.asarray(csi @ _mapping(n_tx, is_40mhz(rate)), np.complex64)


@lru_cache(maxsize=8)
def _mapping(n_tx: int, wide: bool) -> Complex:
    """The conjugate transpose of the sender's unitary matrix."""
    if n_tx == 2:
        cross = 1j if wide else 1.0
        matrix = np.array([[1, cross], [cross, 1 if wide else -1]]) / np.sqrt(2)
    else:
        turns = (
            [[-1 / 16, -13 / 80, 23 / 80], [-37 / 80, -11 / 48, -107 / 240], [7 / 80, -83 / 240, -11 / 48]]
            if wide
            else [[-1 / 16, -33 / 80, 3 / 80], [23 / 80, 13 / 48, 13 / 240], [-13 / 80, 37 / 240, 13 / 48]]
        )
        matrix = np.exp(2j * np.pi * np.array(turns)) / np.sqrt(3)
    return np.asarray(matrix.conj().T, np.complex64)
