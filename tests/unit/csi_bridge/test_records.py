"""Which antenna a row is of."""

from __future__ import annotations

import pytest

from csi_bridge.records import row_antennas, row_ranks


@pytest.mark.parametrize(
    ("antenna_sel", "n_rx", "antennas", "ranks"),
    [
        (0b100100, 3, (0, 1, 2), (0, 1, 2)),
        (0b000110, 3, (2, 1, 0), (2, 1, 0)),
        (0b010101, 3, (0, 1, 2), (0, 1, 2)),  # three times antenna B cannot be
        (0b111001, 3, (0, 1, 2), (0, 1, 2)),  # there is no fourth antenna
        (0b011000, 2, (0, 2), (0, 1)),
        (0b000010, 2, (2, 0), (1, 0)),
        (0b000001, 1, (1,), (0,)),
    ],
)
def test_antenna_selection(antenna_sel: int, n_rx: int, antennas: tuple[int, ...], ranks: tuple[int, ...]) -> None:
    assert row_antennas(antenna_sel, n_rx) == antennas
    assert row_ranks(antenna_sel, n_rx) == ranks
