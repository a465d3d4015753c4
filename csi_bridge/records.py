"""What the Intel 5300 reports: CSI records and MPDU records, and the one error its bytes can cause."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

CSI_CODE: Final = 0xBB
MPDU_CODE: Final = 0xC1
SUBCARRIERS: Final = 30
MAX_ANTENNAS: Final = 3


class CsiError(ValueError):
    """Bytes that are no record of the driver. `offset` is where in the fed bytes the broken record starts."""

    def __init__(self, reason: str, offset: int = 0) -> None:
        super().__init__(f"byte {offset}: {reason}")
        self.reason = reason
        self.offset = offset


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CsiHead:
    """What a beamforming report says beside the channel of the received packet."""

    timestamp_low_us: int
    """Lower 32 bits of the NIC's microsecond clock at reception."""
    bfee_count: int
    """Reports made since the driver started, 16 bits: a gap is a lost record."""
    n_rx: int
    n_tx: int
    rssi: tuple[int, int, int]
    """Antennas A, B, C in dB before AGC; 0 where an antenna is absent."""
    noise_dbm: int
    agc: int
    antenna_sel: int
    rate: int
    layout: int
    """Bytes of header before the payload: 20 stock driver, 34 with host time and MAC, 38 with a frame counter too."""
    host_time_ns: int | None = None
    """Wall time of the host, from tv_sec and tv_usec."""
    mac: bytes | None = None
    """Six bytes of the sender's address; all zero when the driver did not know it."""
    frame_count: int | None = None
    """32 bits: the sender's ping number, echoed by the answering side."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CsiRecord(CsiHead):
    """One beamforming report: the channel of one received packet."""

    csi: npt.NDArray[np.complex64]
    """Shape (30, n_rx, n_tx), parts int8-valued; row r is antenna `antennas[r]`, in the order A, B, C."""

    @property
    def antennas(self) -> tuple[int, ...]:
        """Receive antenna (0 = A) of each row of `csi`, ascending."""
        return tuple(sorted(row_antennas(self.antenna_sel, self.n_rx)))


@dataclass(frozen=True, slots=True)
class MpduRecord:
    """The frame whose CSI follows in the next record."""

    payload: bytes


@lru_cache(maxsize=1024)
def row_antennas(antenna_sel: int, n_rx: int) -> tuple[int, ...]:
    """Antenna (0 = A) of each payload row, from 2 bits per row; 0, 1, .. where `antenna_sel` cannot be right."""
    antennas = tuple(antenna_sel >> 2 * row & 3 for row in range(n_rx))
    valid = len(set(antennas)) == n_rx and max(antennas) < MAX_ANTENNAS
    return antennas if valid else tuple(range(n_rx))


@lru_cache(maxsize=1024)
def row_ranks(antenna_sel: int, n_rx: int) -> tuple[int, ...]:
    """Place of each payload row when rows are sorted by antenna: a permutation of 0..n_rx-1."""
    antennas = row_antennas(antenna_sel, n_rx)
    return tuple(sorted(antennas).index(antenna) for antenna in antennas)
