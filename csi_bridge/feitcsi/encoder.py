"""FeitCSI records to bytes: the exact inverse of the parser, for the radio simulator and for whoever writes a log.

A log is one encoded record behind the other. A record that was read is written with every byte it came with, those
without a known meaning too; one that was made begins with a header of zeros.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from csi_bridge.encoder import EncodeError
from csi_bridge.feitcsi.parser import record_size
from csi_bridge.feitcsi.records import HEADER_BYTES, FeitRecord
from csi_bridge.records import CsiError

_PLACES: Final = (("<I", 0), ("<I", 8), ("<Q", 12), ("<BB", 46), ("<I", 52), ("<II", 60), ("<6s", 68), ("<II", 88))


def encode_record(record: FeitRecord) -> bytes:
    """Header and data; what the header has beyond the known fields stays as it is. Raises EncodeError."""
    if len(record.header) != HEADER_BYTES:
        raise EncodeError(f"header of {len(record.header)} bytes, expected {HEADER_BYTES}")
    if len(record.mac) != 6:
        raise EncodeError(f"address of {len(record.mac)} bytes, expected 6")
    data = _data(record)
    header = bytearray(record.header)
    try:
        for (layout, at), values in zip(_PLACES, _values(record, len(data)), strict=True):
            struct.pack_into(layout, header, at, *values)
        size = record_size(header)
    except struct.error as error:
        raise EncodeError(f"a header field does not fit its width: {error}") from None
    except CsiError as error:
        raise EncodeError(error.reason) from None
    assert size == len(header) + len(data)
    return bytes(header) + data


def _values(record: FeitRecord, size: int) -> tuple[tuple[int | bytes, ...], ...]:
    subcarriers, n_rx, n_tx = record.csi.shape
    power_a, power_b = record.rssi_dbm
    return (
        (size,),
        (record.ftm_ticks,),
        (record.host_time_us,),
        (n_rx, n_tx),
        (subcarriers,),
        (-power_a, -power_b),
        (record.mac,),
        (record.timestamp_low_us, record.rate.word),
    )


def _data(record: FeitRecord) -> bytes:
    if record.csi.ndim != 3:
        raise EncodeError(f"csi of shape {record.csi.shape}, expected (subcarriers, n_rx, n_tx)")
    parts = np.ascontiguousarray(record.csi.transpose(1, 2, 0), np.complex64).view(np.float32)
    if not (np.array_equal(parts, np.rint(parts)) and parts.min() >= -(1 << 15) and parts.max() < 1 << 15):
        raise EncodeError("csi parts must be whole numbers in -32768..32767")
    return parts.astype("<i2").tobytes()
