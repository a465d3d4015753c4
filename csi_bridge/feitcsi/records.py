"""One FeitCSI report: the header's fields, and the channel as the card reports it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.feitcsi.rate import Rate
from csi_bridge.feitcsi.tones import Tones, tones_of

FEITCSI_CODE: Final = 0x4E
"""Code of a report, header and data, wherever records of several cards travel together."""
HEADER_BYTES: Final = 272
MAX_RX: Final = 2
MAX_TX: Final = 4
TICKS_PER_US: Final = 320


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeitRecord:
    """The report of one received packet."""

    ftm_ticks: int
    """The fine clock at reception, 32 bits of 3.125 ns: wraps every 13.4 s."""
    host_time_us: int
    """Wall time of the host; 0 where the logger did not know it."""
    rssi_dbm: tuple[int, int]
    """Received by chains A and B."""
    mac: bytes
    """Six bytes of the sender's address."""
    timestamp_low_us: int
    """Lower 32 bits of the card's microsecond clock."""
    rate: Rate
    csi: npt.NDArray[np.complex64]
    """Shape (S, n_rx, n_tx), parts int16-valued, lowest frequency first, as reported; see `channel`."""
    header: bytes
    """All 272 bytes of it: most have no known meaning, and are written back as they came."""

    @property
    def n_rx(self) -> int:
        return int(self.csi.shape[1])

    @property
    def n_tx(self) -> int:
        return int(self.csi.shape[2])

    @property
    def antennas(self) -> tuple[int, ...]:
        """Receive antenna (0 = A) of each row of `csi`."""
        named = self.rate.antennas
        return named if len(named) == self.n_rx else tuple(range(self.n_rx))

    @property
    def tones(self) -> Tones:
        """The parser refuses reports of formats that have none."""
        plan = tones_of(self.rate.word)
        assert plan is not None
        return plan

    @property
    def subcarrier_hz(self) -> npt.NDArray[np.float64]:
        """Frequencies (S,) of the subcarriers, from the channel's centre."""
        return self.tones.frequency_hz

    @property
    def power_dbm(self) -> float:
        """Received over all chains; -inf where none received anything."""
        heard = [value for value in self.rssi_dbm if value]
        return 10 * float(np.log10(sum(10 ** (value / 10) for value in heard))) if heard else -np.inf
