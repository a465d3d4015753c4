"""Bytes to records, without I/O: one record body at a time.

A CSI body is little-endian:
timestamp u32 @0, bfee_count u16 @4, n_rx u8 @8, n_tx u8 @9, rssi 3 x u8 @10, noise i8 @13, agc u8 @14, antenna_sel
u8 @15, payload length u16 @16, rate u16 @18; then, in patched drivers, tv_sec u32 @20, tv_usec u32 @24, MAC @28 and
frame_count u32 @34; then the payload.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.payload import payload_bytes, unpack
from csi_bridge.records import (
    CSI_CODE,
    MAX_ANTENNAS,
    MPDU_CODE,
    SUBCARRIERS,
    CsiError,
    CsiHead,
    CsiRecord,
    MpduRecord,
    row_ranks,
)

LAYOUTS: Final = (20, 34, 38)
HEADER: Final = struct.Struct("<IHHBBBBBbBBHH")
STAMP: Final = struct.Struct("<II6s")
COUNTER: Final = struct.Struct("<I")


def parse_body(code: int, body: bytes) -> CsiRecord | MpduRecord | None:
    """One record from its code and body; None for a code that is neither CSI nor MPDU. Raises CsiError."""
    if code == MPDU_CODE:
        return MpduRecord(bytes(body))
    if code != CSI_CODE:
        return None
    head = parse_head(body)
    return CsiRecord(csi=channels([body])[0], **dataclasses.asdict(head))


def parse_head(body: bytes) -> CsiHead:
    """All that a CSI body says but the channel; every length in it is checked. Raises CsiError."""
    layout, n_rx, n_tx = body_shape(body)
    stamp_us, count, _, _, _, rssi_a, rssi_b, rssi_c, noise, agc, antenna_sel, _, rate = HEADER.unpack_from(body)
    host_time_ns, mac, frame_count = _stamp(body, layout)
    return CsiHead(
        timestamp_low_us=stamp_us,
        bfee_count=count,
        n_rx=n_rx,
        n_tx=n_tx,
        rssi=(rssi_a, rssi_b, rssi_c),
        noise_dbm=noise,
        agc=agc,
        antenna_sel=antenna_sel,
        rate=rate,
        layout=layout,
        host_time_ns=host_time_ns,
        mac=mac,
        frame_count=frame_count,
    )


def channels(bodies: Sequence[bytes]) -> npt.NDArray[np.complex64]:
    """The channels (N, 30, n_rx, n_tx), N > 0, of bodies that `parse_head` takes and that agree in numbers of antennas,
    antenna_sel and layout; rows as of `CsiRecord.csi`. Many at once take little longer than one."""
    layout, n_rx, n_tx = body_shape(bodies[0])
    data = np.frombuffer(b"".join(bodies), np.uint8).reshape(len(bodies), -1)
    csi = np.empty((len(bodies), SUBCARRIERS, n_rx, n_tx), np.complex64)
    csi[:, :, row_ranks(bodies[0][15], n_rx)] = unpack(data[:, layout:], n_rx, n_tx)
    return csi


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


def _stamp(body: bytes, layout: int) -> tuple[int | None, bytes | None, int | None]:
    if layout == 20:
        return None, None, None
    seconds, microseconds, mac = STAMP.unpack_from(body, 20)
    frame_count = COUNTER.unpack_from(body, 34)[0] if layout == 38 else None
    return seconds * 1_000_000_000 + microseconds * 1000, mac, frame_count
