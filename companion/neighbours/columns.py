"""Tables of small whole numbers in few bits. A column is its least value, the number of bits that its rows need above
that, and those bits: neighbours in time are alike, so that most of a number need not be sent again and again.

First the heads of all columns (least value in the column's own size, then the width in 5 bits), filled to a whole byte;
then the rows of the first column, of the second, and so on without a gap, filled to a whole byte. Lowest bit first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.int64]
_WIDTH_BITS: Final = 5
_MOST_BITS: Final = 24
_SHIFTS: Final = np.arange(_MOST_BITS)
_WEIGHTS: Final = np.exp2(np.arange(_MOST_BITS)).astype(np.float32)


def pack(columns: Sequence[tuple[Values, int]]) -> bytes:
    """(values (N,), bits of the largest there may be) of each column, none negative. Raises ValueError for a value that
    is not within its bits."""
    head = head_bits = 0
    rows: list[npt.NDArray[np.uint8]] = []
    for values, size in columns:
        least, most = (int(values.min()), int(values.max())) if len(values) else (0, 0)
        if least < 0 or most >> min(size, _MOST_BITS):
            raise ValueError(f"a column of {size} bits holds {least}..{most}")
        width = (most - least).bit_length()
        head |= (least | width << size) << head_bits
        head_bits += size + _WIDTH_BITS
        rows.append((((values - least)[:, np.newaxis] >> _SHIFTS[:width]) & 1).astype(np.uint8).ravel())
    packed = np.packbits(np.concatenate(rows), bitorder="little").tobytes() if rows else b""
    return head.to_bytes((head_bits + 7) // 8, "little") + packed


def unpack(data: bytes, columns: Sequence[tuple[int, int]]) -> list[Values]:
    """The values of each column, given how many rows it has and its bits. Raises ValueError unless `data` is just
    that."""
    head_bits = sum(size + _WIDTH_BITS for _, size in columns)
    start = (head_bits + 7) // 8
    head = int.from_bytes(data[:start], "little")
    # Numbers of up to 24 bits are whole in float32, whose products are the fast ones.
    bits = np.unpackbits(np.frombuffer(data, np.uint8, offset=min(start, len(data))), bitorder="little")
    weighable = bits.astype(np.float32)
    found, at = [], 0
    for count, size in columns:
        least, width = head & (1 << size) - 1, head >> size & (1 << _WIDTH_BITS) - 1
        head >>= size + _WIDTH_BITS
        if width > size or at + count * width > len(bits):
            raise ValueError(f"a column of {count} rows with {width} bits, {len(bits) - at} left")
        rows = weighable[at : at + count * width].reshape(count, width)
        found.append((rows @ _WEIGHTS[:width]).astype(np.int64) + least)
        at += count * width
    if len(data) < start or len(bits) - at >= 8 or head or bits[at:].any():
        raise ValueError(f"{len(data)} bytes, expected {start + (at + 7) // 8}")
    return found
