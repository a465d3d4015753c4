"""Bytes to records, without I/O: one record body at a time, or a log file in pieces of any size.

A log is a sequence of frames: u16 big-endian length of code and body, u8 code, body. A CSI body is little-endian:
timestamp u32 @0, bfee_count u16 @4, n_rx u8 @8, n_tx u8 @9, rssi 3 x u8 @10, noise i8 @13, agc u8 @14, antenna_sel
u8 @15, payload length u16 @16, rate u16 @18; then, in patched drivers, tv_sec u32 @20, tv_usec u32 @24, MAC @28 and
frame_count u32 @34; then the payload.
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from csi_bridge.payload import payload_bytes, unpack
from csi_bridge.records import CSI_CODE, MAX_ANTENNAS, MPDU_CODE, CsiError, CsiRecord, MpduRecord, row_ranks

LAYOUTS: Final = (20, 34, 38)
HEADER: Final = struct.Struct("<IHHBBBBBbBBHH")
STAMP: Final = struct.Struct("<II6s")
COUNTER: Final = struct.Struct("<I")
MIN_CSI_FRAME: Final = 1 + HEADER.size + payload_bytes(1, 1)
MAX_CSI_FRAME: Final = 1 + LAYOUTS[-1] + payload_bytes(MAX_ANTENNAS, MAX_ANTENNAS)
MAX_FRAME: Final = 8191
"""Code and body of any record: the longest are MPDUs, of which the card reports the first 4 KiB."""


def parse_body(code: int, body: bytes) -> CsiRecord | MpduRecord | None:
    """One record from its code and body; None for a code that is neither CSI nor MPDU. Raises CsiError."""
    if code == MPDU_CODE:
        return MpduRecord(bytes(body))
    if code != CSI_CODE:
        return None
    layout, n_rx, n_tx = body_shape(body)
    fields = HEADER.unpack_from(body)
    stamp_us, count, _, _, _, rssi_a, rssi_b, rssi_c, noise, agc, antenna_sel, _, rate = fields
    payload = np.frombuffer(body, np.uint8, offset=layout)[np.newaxis]
    csi = np.empty((30, n_rx, n_tx), np.complex64)
    csi[:, row_ranks(antenna_sel, n_rx)] = unpack(payload, n_rx, n_tx)[0]
    host_time_ns, mac, frame_count = _stamp(body, layout)
    return CsiRecord(
        timestamp_low_us=stamp_us,
        bfee_count=count,
        n_rx=n_rx,
        n_tx=n_tx,
        rssi=(rssi_a, rssi_b, rssi_c),
        noise_dbm=noise,
        agc=agc,
        antenna_sel=antenna_sel,
        rate=rate,
        csi=csi,
        layout=layout,
        host_time_ns=host_time_ns,
        mac=mac,
        frame_count=frame_count,
    )


def body_shape(body: bytes | memoryview) -> tuple[int, int, int]:
    """(layout, n_rx, n_tx) of a CSI body, every length in it checked. Raises CsiError."""
    if len(body) < HEADER.size:
        raise CsiError(f"CSI body of {len(body)} bytes, expected at least {HEADER.size}")
    n_rx, n_tx = body[8], body[9]
    if not (1 <= n_rx <= MAX_ANTENNAS and 1 <= n_tx <= MAX_ANTENNAS):
        raise CsiError(f"CSI of {n_rx} x {n_tx} antennas, expected 1..{MAX_ANTENNAS} each")
    length = body[16] | body[17] << 8
    if length != payload_bytes(n_rx, n_tx):
        raise CsiError(f"payload of {length} bytes, expected {payload_bytes(n_rx, n_tx)} for {n_rx} x {n_tx} antennas")
    layout = len(body) - length
    if layout not in LAYOUTS:
        raise CsiError(f"header of {layout} bytes, expected one of {LAYOUTS}")
    return layout, n_rx, n_tx


class CsiLogParser:
    """A log in pieces: `feed` bytes, take records with `next_record` until it returns None.

    A broken record raises CsiError once. The next call goes on behind it where something like a record stands there;
    else its length was wrong, and the parser looks for the next sound CSI record.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._start = 0
        self._offset = 0
        self._lost = False
        self._broken_end: int | None = None
        self.unknown_count = 0
        """Records of other codes, skipped."""
        self.skipped_bytes = 0
        """Passed over while looking for a record."""

    @property
    def pending_bytes(self) -> int:
        """Bytes fed of a record whose end has not arrived."""
        return len(self._buffer) - self._start

    def feed(self, data: bytes) -> None:
        del self._buffer[: self._start]
        self._start = 0
        self._buffer += data

    def next_record(self) -> tuple[int, CsiRecord | MpduRecord] | None:
        """(offset of the record in all bytes fed, record), or None for "need more". Raises CsiError."""
        while True:
            if self._broken_end is not None and not self._leave(self._broken_end):
                return None
            if self._lost and not self._find():
                return None
            frame = self._frame()
            if frame is None or frame[1] > len(self._buffer):
                return None
            code, end = frame
            offset = self._offset
            try:
                record = parse_body(code, bytes(self._buffer[self._start + 3 : end]))
            except CsiError as error:
                self._broken_end = end - self._start
                raise CsiError(error.reason, offset) from None
            self._advance(end)
            if record is not None:
                return offset, record
            self.unknown_count += 1

    def _frame(self) -> tuple[int, int] | None:
        """(code, end) of what stands at the start, though its end may not be there yet. Raises CsiError for a length
        that nothing has."""
        data, start = self._buffer, self._start
        if len(data) - start < 3:
            return None
        length = data[start] << 8 | data[start + 1]
        longest = MAX_FRAME if data[start + 2] == MPDU_CODE else MAX_CSI_FRAME
        if not 1 <= length <= longest:
            offset = self._offset
            self._lost = True
            self._skip(start + 1)
            raise CsiError(f"record length {length}, expected 1..{longest}", offset)
        return data[start + 2], start + 2 + length

    def _leave(self, size: int) -> bool:
        """Past a broken record of `size` bytes, or into it where nothing stands behind it; False to see more first."""
        data, end = self._buffer, self._start + size
        if len(data) - end < 3:
            return False
        self._broken_end = None
        length = data[end] << 8 | data[end + 1]
        if 1 <= length <= MAX_FRAME and data[end + 2] in (CSI_CODE, MPDU_CODE):
            self._advance(end)
        else:
            self._lost = True
            self._skip(self._start + 1)
        return True

    def _find(self) -> bool:
        """Advances to the next sound CSI record; False when more bytes are needed to see one."""
        data, at = self._buffer, self._start
        while (code_at := data.find(CSI_CODE, at + 2)) >= 0:
            at = code_at - 2
            length = data[at] << 8 | data[at + 1]
            if MIN_CSI_FRAME <= length <= MAX_CSI_FRAME:
                if at + 2 + length > len(data):
                    self._skip(at)
                    return False
                try:
                    body_shape(memoryview(data)[at + 3 : at + 2 + length])
                except CsiError:
                    pass
                else:
                    self._skip(at)
                    self._lost = False
                    return True
            at += 1
        self._skip(max(self._start, len(data) - 2))
        return False

    def _skip(self, to: int) -> None:
        self.skipped_bytes += to - self._start
        self._advance(to)

    def _advance(self, end: int) -> None:
        self._offset += end - self._start
        self._start = end


def _stamp(body: bytes, layout: int) -> tuple[int | None, bytes | None, int | None]:
    if layout == 20:
        return None, None, None
    seconds, microseconds, mac = STAMP.unpack_from(body, 20)
    frame_count = COUNTER.unpack_from(body, 34)[0] if layout == 38 else None
    return seconds * 1_000_000_000 + microseconds * 1000, mac, frame_count
