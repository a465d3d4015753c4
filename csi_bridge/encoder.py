"""Records to bytes: the exact inverse of the parser, for the radio simulator and for tests."""

from __future__ import annotations

import struct
from collections.abc import Sequence

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
    return encode_bodies([record])[0]


def encode_bodies(records: Sequence[CsiRecord]) -> list[bytes]:
    """The same of records with the same numbers of antennas, at a third of the cost of one by one."""
    if not records:
        return []
    for record in records:
        _check(record)
    if len({record.csi.shape for record in records}) > 1:
        raise EncodeError("records of different numbers of antennas; encode them apart")
    csi = np.stack([record.csi for record in records]).astype(np.complex64)
    parts = csi.view(np.float32)
    # What is no number equals nothing, itself included.
    if not (np.minimum(np.maximum(np.rint(parts), -128), 127) == parts).all():
        raise EncodeError("csi parts must be whole numbers in -128..127")
    ranks = np.array([row_ranks(record.antenna_sel, record.n_rx) for record in records])
    payloads = pack(np.take_along_axis(csi, ranks[:, None, :, None], axis=2))
    return [_header(record, payload) + payload for record, payload in zip(records, payloads, strict=True)]


def _header(record: CsiRecord, payload: bytes) -> bytes:
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
        return head + _stamp(record)
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
