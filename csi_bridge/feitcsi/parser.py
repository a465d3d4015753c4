"""Bytes to FeitCSI records, without I/O: one record at a time, or a log in pieces of any size.

A record is a header of 272 bytes and its data. Header, little-endian: bytes of data u32 @0, fine clock u32 @8, host
microseconds u64 @12, n_rx u8 @46, n_tx u8 @47, subcarriers u32 @52, minus the power of chains A and B in dBm u32 @60
and @64, sender's address @68, microsecond clock u32 @88, rate word u32 @92. Data: int16 real and imaginary parts
by receive chain, stream and subcarrier. There is no mark and no check sum: a record is known by numbers that agree.
"""

from __future__ import annotations

import re
import struct
from typing import Final

import numpy as np

from csi_bridge.feitcsi.rate import Rate
from csi_bridge.feitcsi.records import HEADER_BYTES, MAX_RX, MAX_TX, FeitRecord
from csi_bridge.feitcsi.tones import SUBCARRIERS, tones_of
from csi_bridge.records import CsiError

FIELDS: Final = struct.Struct("<I4xIQ26xBB4xI4xII6s14xII")
"""Data bytes, fine clock, host time, n_rx, n_tx, subcarriers, powers of A and B, address, microseconds, rate word."""
SHAPE: Final = struct.Struct("<BB4xI")
SHAPE_AT: Final = 46
RATE_AT: Final = 92
_MAX_DBM: Final = 200
_SHOWS: Final = 96
"""Bytes of a header that have something to agree."""
_LIKELY: Final = re.compile(
    rb"(?s).{46}[\x01-%c][\x01-%c].{4}(?:%b)"
    % (MAX_RX, MAX_TX, b"|".join(re.escape(struct.pack("<I", count)) for count in SUBCARRIERS))
)


def record_size(header: bytes | bytearray | memoryview) -> int:
    """Bytes of the whole record, from at least the first 96 of them; every number checked against the others. Raises
    CsiError."""
    if len(header) < _SHOWS:
        raise CsiError(f"header of {len(header)} bytes, expected {HEADER_BYTES}")
    size = int.from_bytes(header[:4], "little")
    n_rx, n_tx, subcarriers = SHAPE.unpack_from(header, SHAPE_AT)
    if not (1 <= n_rx <= MAX_RX and 1 <= n_tx <= MAX_TX):
        raise CsiError(f"{n_rx} x {n_tx} antennas, expected at most {MAX_RX} x {MAX_TX}, and one of each")
    word = int.from_bytes(header[RATE_AT : RATE_AT + 4], "little")
    plan = tones_of(word)
    if plan is None:
        raise CsiError(f"rate word {word:#010x}, {Rate(word)}: its subcarriers are not known")
    if subcarriers != len(plan.index):
        raise CsiError(f"{subcarriers} subcarriers, expected {len(plan.index)} of {Rate(word)}")
    if size != 4 * n_rx * n_tx * subcarriers:
        raise CsiError(f"{size} bytes of data, expected {4 * n_rx * n_tx * subcarriers} for {n_rx} x {n_tx} antennas")
    return HEADER_BYTES + size


def parse_record(data: bytes | memoryview) -> FeitRecord:
    """One whole record. Raises CsiError."""
    size = record_size(data[:HEADER_BYTES])
    if len(data) != size:
        raise CsiError(f"record of {len(data)} bytes, expected {size}")
    _, ftm, host_us, n_rx, n_tx, subcarriers, minus_a, minus_b, mac, stamp_us, word = FIELDS.unpack_from(data)
    if max(minus_a, minus_b) > _MAX_DBM:
        raise CsiError(f"power of -{max(minus_a, minus_b)} dBm, expected 0 to -{_MAX_DBM}")
    parts = np.frombuffer(data, "<i2", offset=HEADER_BYTES).astype(np.float32)
    csi = parts.view(np.complex64).reshape(n_rx, n_tx, subcarriers).transpose(2, 0, 1)
    return FeitRecord(
        ftm_ticks=ftm,
        host_time_us=host_us,
        rssi_dbm=(-minus_a, -minus_b),
        mac=mac,
        timestamp_low_us=stamp_us,
        rate=Rate(word),
        csi=csi,
        header=bytes(data[:HEADER_BYTES]),
    )


def sender_of(data: bytes) -> bytes:
    """The sender's address in a whole record, which is not looked at further."""
    mac: bytes = FIELDS.unpack_from(data)[8]
    return mac


def next_record_at(data: bytes | bytearray, start: int = 0) -> int:
    """Where the first sound header at or behind `start` begins; where one might that is not all there; else the end."""
    while (found := _LIKELY.search(data, start)) is not None and len(data) - found.start() >= _SHOWS:
        try:
            record_size(bytes(data[found.start() : found.start() + _SHOWS]))
        except CsiError:
            start = found.start() + 1
        else:
            return found.start()
    return max(start, len(data) - _SHOWS + 1)


class FeitLogParser:
    """A log in pieces: `feed` bytes, take records with `next_record` until it returns None.

    Where no record stands, CsiError is raised once, and the next call goes on with the next sound header. It may lie in
    what was taken for the end of the record before, which then was shorter than it said.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._start = 0
        self._offset = 0
        self._earliest = 0
        """From where on the next record may begin: behind the header of the last one."""
        self._lost = False
        self.skipped_bytes = 0
        """Passed over while looking for a record."""

    @property
    def pending_bytes(self) -> int:
        """Bytes fed of a record whose end has not arrived."""
        return len(self._buffer) - self._start

    @property
    def is_lost(self) -> bool:
        """Whether what is pending begins with no header."""
        return self._lost

    def feed(self, data: bytes) -> None:
        del self._buffer[: self._earliest]
        self._offset += self._earliest
        self._start -= self._earliest
        self._earliest = 0
        self._buffer += data

    def next_record(self) -> tuple[int, FeitRecord] | None:
        """(offset of the record in all bytes fed, record), or None for "need more". Raises CsiError."""
        if self._lost and not self._find():
            return None
        start = self._start
        if len(self._buffer) - start < _SHOWS:
            return None
        offset = self._offset + start
        try:
            end = start + record_size(self._buffer[start : start + _SHOWS])
            if end > len(self._buffer):
                return None
            record = parse_record(bytes(self._buffer[start:end]))
        except CsiError as error:
            self._lost = True
            self._earliest = start + 1 if start == self._earliest else self._earliest
            raise CsiError(error.reason, offset) from None
        self._earliest, self._start = start + HEADER_BYTES, end
        return offset, record

    def take_whole(self) -> tuple[list[tuple[int, FeitRecord]], int]:
        """Every record that is whole by now, as of `next_record`, and how often none stood where one had to."""
        found, damaged = list[tuple[int, FeitRecord]](), 0
        while True:
            try:
                item = self.next_record()
            except CsiError:
                damaged += 1
                continue
            if item is None:
                return found, damaged
            found.append(item)

    def _find(self) -> bool:
        """Advances to the next sound header; False when more bytes are needed to see one."""
        at = next_record_at(self._buffer, self._earliest)
        self.skipped_bytes += max(at - self._start, 0)
        self._start = self._earliest = at
        self._lost = len(self._buffer) - at < _SHOWS
        return not self._lost
