"""The packed CSI payload: 30 subcarriers, each 3 bits of padding and then int8 real, int8 imaginary per antenna pair
(receive antenna outer, transmit antenna inner), least significant bit first (read_bfee.c of the 802.11n CSI Tool).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from csi_bridge.records import SUBCARRIERS

_PADDING_BITS = 3


def payload_bytes(n_rx: int, n_tx: int) -> int:
    """Bytes of a payload: (30 * (n_rx * n_tx * 16 + 3) + 7) // 8."""
    return (SUBCARRIERS * (n_rx * n_tx * 16 + _PADDING_BITS) + 7) // 8


def unpack(payload: npt.NDArray[np.uint8], n_rx: int, n_tx: int) -> npt.NDArray[np.complex64]:
    """Payloads (N, payload_bytes) uint8 -> (N, 30, n_rx, n_tx) complex64 in payload row order."""
    index, shift = _positions(n_rx * n_tx)
    # Each value sits in two neighbouring bytes; one gather of byte pairs is half the work of two of bytes.
    pairs = payload[:, 1:].astype(np.uint16)
    pairs <<= 8
    pairs |= payload[:, :-1]
    parts = np.take(pairs, index, axis=1)
    parts >>= shift
    return (
        parts.astype(np.uint8)
        .view(np.int8)
        .astype(np.float32)
        .view(np.complex64)
        .reshape(len(payload), SUBCARRIERS, n_rx, n_tx)
    )


def pack(csi: npt.NDArray[np.complex64]) -> list[bytes]:
    """Inverse of `unpack` for int8-valued (N, 30, n_rx, n_tx) in payload row order; padding bits are zero."""
    count, _, n_rx, n_tx = csi.shape
    values = np.ascontiguousarray(csi).view(np.float32).astype(np.int8).view(np.uint8)
    bits = np.unpackbits(values.reshape(count, SUBCARRIERS, -1), axis=2, bitorder="little")
    padded = np.zeros((count, SUBCARRIERS, _PADDING_BITS + 16 * n_rx * n_tx), np.uint8)
    padded[:, :, _PADDING_BITS:] = bits
    packed = np.packbits(padded.reshape(count, -1), axis=1, bitorder="little")
    assert packed.shape[1] == payload_bytes(n_rx, n_tx)
    return [row.tobytes() for row in packed]


@lru_cache(maxsize=16)
def _positions(pairs: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.uint16]]:
    subcarrier, value = np.divmod(np.arange(SUBCARRIERS * pairs * 2), pairs * 2)
    bit = subcarrier * (pairs * 16 + _PADDING_BITS) + _PADDING_BITS + value * 8
    return bit // 8, (bit % 8).astype(np.uint16)
