"""Columns of whole numbers: what goes in comes out in few bits, anything else is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.neighbours.columns import pack, unpack


@given(st.data())
def test_whatever_fits_its_bits_comes_back(data: st.DataObject) -> None:
    sizes = data.draw(st.lists(st.integers(1, 22), max_size=6))
    columns = [
        (np.array(data.draw(st.lists(st.integers(0, 2**size - 1), max_size=30)), np.int64), size) for size in sizes
    ]
    packed = pack(columns)
    found = unpack(packed, [(len(values), size) for values, size in columns])
    for (values, _), back in zip(columns, found, strict=True):
        np.testing.assert_array_equal(back, values)
    if columns:
        with pytest.raises(ValueError, match=r"expected|left"):
            unpack(packed + b"\0", [(len(values), size) for values, size in columns])
        with pytest.raises(ValueError, match=r"expected|left"):
            unpack(packed[:-1], [(len(values), size) for values, size in columns])


def _bit_by_bit(data: bytes, columns: list[tuple[int, int]]) -> list[list[int]]:
    """The layout as its description says it, read the slow way."""
    bits = iter([byte >> i & 1 for byte in data for i in range(8)])

    def number(size: int) -> int:
        return sum(next(bits) << i for i in range(size))

    heads = [(number(size), number(5)) for _, size in columns]
    for _ in range(-sum(size + 5 for _, size in columns) % 8):
        next(bits)
    return [
        [least + number(width) for _ in range(count)] for (count, _), (least, width) in zip(columns, heads, strict=True)
    ]


@given(st.data())
def test_columns_of_every_width_are_read_as_bit_by_bit(data: st.DataObject) -> None:
    """At every offset within a byte, since the widths before are any."""
    shape = data.draw(st.lists(st.tuples(st.integers(0, 20), st.integers(1, 31)), max_size=6))
    columns = []
    for count, size in shape:
        most = 2 ** data.draw(st.integers(0, size)) - 1
        values = data.draw(st.lists(st.integers(0, most), min_size=count, max_size=count))
        columns.append((np.array(values, np.int64), size))
    packed = pack(columns)
    found = unpack(packed, shape)
    assert [values.tolist() for values in found] == _bit_by_bit(packed, shape)
    assert all(values.dtype == np.int64 for values in found)


@given(st.binary(max_size=60))
def test_any_bytes_are_columns_or_a_value_error(data: bytes) -> None:
    shape = [(3, 14), (2, 8), (0, 22), (4, 6)]
    try:
        found = unpack(data, shape)
    except ValueError:
        return
    assert [len(values) for values in found] == [3, 2, 0, 4]


def test_equal_rows_take_no_bits_and_too_large_ones_are_refused() -> None:
    assert len(pack([(np.full(1000, 77), 8)])) == 2
    for wrong in (-1, 256):
        with pytest.raises(ValueError, match="8 bits"):
            pack([(np.array([3, wrong]), 8)])


def test_a_column_wider_than_its_numbers_is_refused() -> None:
    with pytest.raises(ValueError, match="left"):
        unpack((31 << 8).to_bytes(2, "little") + bytes(40), [(3, 8)])
