"""FeitCSI logs as `csi_bridge.dat.CsiLog`, so that recordings of both cards are joined and estimated by one path.

Read in pieces, each record thinned at once (`channel.thinned`): memory goes by what estimates need. Records of one
format and width are kept, those that the log has most of.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np

from csi_bridge.dat import CsiLog
from csi_bridge.dat_frames import DatFileError
from csi_bridge.dat_wanted import Wanted
from csi_bridge.feitcsi.channel import Complex, thinned
from csi_bridge.feitcsi.clock import fine_us
from csi_bridge.feitcsi.log import is_feitcsi
from csi_bridge.feitcsi.parser import FeitLogParser
from csi_bridge.feitcsi.records import FeitRecord
from csi_bridge.records import MAX_ANTENNAS
from csi_bridge.regular_file import open_regular

_PIECE: Final = 1 << 20
_SHOWS: Final = 1 << 16


def is_feitcsi_file(path: Path) -> bool:
    """By its content. False for what cannot be read: who reads it says so."""
    try:
        with open_regular(path) as file:
            return is_feitcsi(file.read(_SHOWS))
    except OSError:
        return False


def read_csi_log(path: Path, wanted: Wanted | None = None) -> CsiLog:
    """All records of the usual kind, or those within the wanted host times. Raises DatFileError."""
    parser, found, damaged, left = FeitLogParser(), [], 0, []
    kinds: Counter[str] = Counter()
    try:
        with open_regular(path) as file:
            while piece := file.read(_PIECE):
                parser.feed(piece)
                whole, missed = parser.take_whole()
                damaged += missed
                for _, record in whole:
                    if _is_wanted(record, wanted):
                        kinds[str(record.rate)] += 1
                        found.append(_Kept(record))
                    else:
                        left.append(record.host_time_us * 1e-6)
    except OSError as error:
        raise DatFileError(f"{path}: {error.strerror}") from None
    if not found and not left:
        raise DatFileError(f"{path}: no whole FeitCSI record")
    usual = max(kinds, key=lambda name: kinds[name], default="")
    kept = [one for one in found if one.kind == usual]
    lost = parser.pending_bytes if parser.is_lost else 0
    return _log(
        path,
        kept,
        damaged=damaged,
        skipped=parser.skipped_bytes + lost,
        cut_off=parser.pending_bytes - lost,
        other={name: count for name, count in kinds.items() if name != usual},
        left=left,
    )


class _Kept:
    """What is left of a record."""

    __slots__ = ("csi", "fields", "hz", "kind", "mac", "rssi")

    def __init__(self, record: FeitRecord) -> None:
        csi, self.hz = thinned(record)
        self.csi: Complex = np.zeros((len(csi), 2), np.complex64)
        self.csi[:, list(record.antennas)] = csi[:, :, 0]
        self.kind, self.mac = str(record.rate), record.mac.hex(":").upper()
        self.rssi = record.rssi_dbm
        # The driver leaves the host's time zero where it does not know it.
        host_s = record.host_time_us * 1e-6 if record.host_time_us else np.nan
        self.fields = (record.timestamp_low_us, record.ftm_ticks, host_s, record.n_rx, record.n_tx)


def _is_wanted(record: FeitRecord, wanted: Wanted | None) -> bool:
    if wanted is None or wanted.time_s is None or not record.host_time_us:
        return True
    return wanted.time_s[0] <= record.host_time_us * 1e-6 <= wanted.time_s[1]


def _log(
    path: Path,
    kept: list[_Kept],
    damaged: int,
    skipped: int,
    cut_off: int,
    other: dict[str, int],
    left: list[float],
) -> CsiLog:
    fields = np.array([one.fields for one in kept], np.float64).reshape(-1, 5)
    stamps, ticks = fields[:, 0].astype(np.uint32), fields[:, 1].astype(np.uint32)
    count, subcarriers = len(kept), len(kept[0].hz) if kept else 0
    csi = np.array([_by_power(one) for one in kept], np.complex64).reshape(count, subcarriers, 2, 1)
    bytes_ = np.zeros(count, np.uint8)
    return CsiLog(
        path=path,
        csi=csi,
        layout=bytes_,
        n_rx=fields[:, 3].astype(np.uint8),
        n_tx=bytes_ + 1,
        timestamp_low_us=stamps,
        bfee_count=np.zeros(count, np.uint16),
        rssi=np.zeros((count, MAX_ANTENNAS), np.uint8),
        noise_dbm=np.zeros(count, np.int8),
        agc=bytes_,
        rate=np.zeros(count, np.uint16),
        host_time_s=fields[:, 2],
        mac=np.array([one.mac for one in kept], dtype="<U17"),
        frame_count=np.full(count, -1, np.int64),
        mpdu_count=0,
        unknown_count=0,
        malformed_count=damaged,
        skipped_bytes=skipped,
        truncated_bytes=cut_off,
        left_out_count=len(left),
        left_out_s=(min(left), max(left)) if left else None,
        subcarrier_hz=kept[0].hz if kept else None,
        fine_us=fine_us(ticks, stamps),
        other_kinds=other,
    )


def _by_power(one: _Kept) -> Complex:
    """Every chain is reported at the same level: what it received is in its power alone, by which one is chosen."""
    heard = np.array([power if power else -np.inf for power in one.rssi])
    best = heard.max()
    share = 10 ** ((heard - best) / 20) if np.isfinite(best) else np.ones(2)
    return np.asarray(one.csi * share.astype(np.float32), np.complex64)
