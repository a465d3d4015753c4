"""Records to bytes: the exact inverse of the parser, for the radio simulator and for tests."""

from __future__ import annotations

import struct

import numpy as np

from csi_bridge.parser import COUNTER, HEADER, LAYOUTS, STAMP
from csi_bridge.payload import pack
from csi_bridge.records import SUBCARRIERS, CsiRecord, row_ranks


class EncodeError(ValueError):
    """A record the driver could not have reported; the message names the field."""


def encode_body(record: CsiRecord) -> bytes:
    """The body of a CSI record; `parse_body(CSI_CODE, ...)` gives the record back.

    `record.csi` is in antenna order with int8-valued parts; antenna_sel's permutation is undone. Raises EncodeError.
    """
    _check(record)
    rows = record.csi[:, row_ranks(record.antenna_sel, record.n_rx)]
    payload = pack(rows.astype(np.complex64))
    try:
        head = HEADER.pack(
            record.timestamp_low_us,
            record.bfee_count,
            0,
            record.n_rx,
            record.n_tx,
            *record.rssi,
            record.noise_dbm,
            record.agc,
            record.antenna_sel,
            len(payload),
            record.rate,
        )
        return head + _stamp(record) + payload
    except struct.error as error:
        raise EncodeError(f"a header field does not fit its width: {error}") from None


def encode_file_record(code: int, body: bytes) -> bytes:
    """A record as it stands in a log file: u16 big-endian length, code, body. Raises EncodeError."""
    if not (0 <= code <= 0xFF and len(body) < 0xFFFF):
        raise EncodeError(f"code {code} with {len(body)} bytes, expected 0..255 with at most 65534")
    return struct.pack(">HB", 1 + len(body), code) + body


def _check(record: CsiRecord) -> None:
    if record.layout not in LAYOUTS:
        raise EncodeError(f"layout {record.layout}, expected one of {LAYOUTS}")
    if record.csi.shape != (SUBCARRIERS, record.n_rx, record.n_tx):
        raise EncodeError(f"csi of shape {record.csi.shape}, expected {(SUBCARRIERS, record.n_rx, record.n_tx)}")
    parts = np.ascontiguousarray(record.csi, np.complex64).view(np.float32)
    if not (np.array_equal(parts, np.rint(parts)) and parts.min() >= -128 and parts.max() <= 127):
        raise EncodeError("csi parts must be whole numbers in -128..127")


def _stamp(record: CsiRecord) -> bytes:
    if record.layout == 20:
        return b""
    if record.host_time_ns is None or record.mac is None or len(record.mac) != 6:
        raise EncodeError(f"layout {record.layout} needs host_time_ns and a MAC of 6 bytes")
    microseconds = record.host_time_ns // 1000
    stamp = STAMP.pack(microseconds // 1_000_000, microseconds % 1_000_000, record.mac)
    if record.layout == 34:
        return stamp
    if record.frame_count is None:
        raise EncodeError("layout 38 needs frame_count")
    return stamp + COUNTER.pack(record.frame_count)
