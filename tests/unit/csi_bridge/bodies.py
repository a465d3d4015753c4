"""Bodies as the driver writes them."""

from __future__ import annotations

import struct


def read_bits(payload: bytes, n_rx: int, n_tx: int) -> list[complex]:
    """The payload as a plain stream of bits: 3 skipped per subcarrier, then two int8 per antenna pair."""
    number = int.from_bytes(payload, "little")
    values, at = [], 0
    for _ in range(30):
        at += 3
        for _ in range(n_rx * n_tx):
            real, imag = (struct.unpack("b", bytes([number >> at + part & 0xFF]))[0] for part in (0, 8))
            values.append(complex(real, imag))
            at += 16
    return values


def stock_body(n_rx: int, n_tx: int, antenna_sel: int, payload: bytes) -> bytes:
    head = struct.pack("<IHH", 123_456_789, 321, 0) + bytes([n_rx, n_tx, 41, 33, 20]) + struct.pack("b", -90)
    return head + bytes([35, antenna_sel]) + struct.pack("<HH", len(payload), 0x1234) + payload
