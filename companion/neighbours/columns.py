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
_MOST_BITS: Final = (1 << _WIDTH_BITS) - 1


def pack(columns: Sequence[tuple[Values | list[int], int]]) -> bytes:
    """(values (N,), bits of the largest there may be) of each column, none negative. Raises ValueError for a value that
    is not within its bits."""
    head = head_bits = rows = row_bits = 0
    for array, size in columns:
        # A column is a few numbers: whole numbers of any length take them in less time than arrays do.
        values = array if isinstance(array, list) else array.tolist()
        least, most = (min(values), max(values)) if values else (0, 0)
        if least < 0 or most >> min(size, _MOST_BITS):
            raise ValueError(f"a column of {size} bits holds {least}..{most}")
        width = (most - least).bit_length()
        head |= (least | width << size) << head_bits
        head_bits += size + _WIDTH_BITS
        column = 0
        for value in reversed(values):
            column = column << width | value - least
        rows |= column << row_bits
        row_bits += width * len(values)
    return head.to_bytes((head_bits + 7) // 8, "little") + rows.to_bytes((row_bits + 7) // 8, "little")


def unpack(data: bytes, columns: Sequence[tuple[int, int]]) -> list[Values]:
    """The values of each column, given how many rows it has and its bits. Raises ValueError unless `data` is just
    that."""
    head_bits = sum(size + _WIDTH_BITS for _, size in columns)
    start = (head_bits + 7) // 8
    head, rows = int.from_bytes(data[:start], "little"), data[start:]
    heads, left = [], 8 * len(rows)
    for count, size in columns:
        least, width = head & (1 << size) - 1, head >> size & (1 << _WIDTH_BITS) - 1
        head >>= size + _WIDTH_BITS
        if width > size or count * width > left:
            raise ValueError(f"a column of {count} rows with {width} bits, {left} left")
        heads.append((count, least, width))
        left -= count * width
    if len(data) < start or left >= 8 or head or (left and rows[-1] >> 8 - left):
        raise ValueError(f"{len(data)} bytes, expected {start + len(rows) - left // 8}")
    return _read(rows, heads)


def _read(rows: bytes, heads: Sequence[tuple[int, int, int]]) -> list[Values]:
    """The columns of which `heads` has the rows, the least value and the width: each row lies within the eight bytes
    from that of its first bit on, and all are read at once."""
    count, least, width = np.array(heads, np.int64).reshape(-1, 3).T
    widths = np.repeat(width, count)
    first = np.cumsum(widths) - widths
    words: Values = np.ndarray(len(rows) + 1, "<i8", rows + bytes(8), strides=(1,))
    values = (words[first >> 3] >> (first & 7)) & ((1 << widths) - 1)
    values += np.repeat(least, count)
    ends = np.cumsum(count).tolist()
    return [values[end - size : end] for (size, _, _), end in zip(heads, ends, strict=True)]
