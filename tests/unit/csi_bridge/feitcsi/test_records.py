"""What a report says of its antennas, its subcarriers and its power."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from csi_bridge.feitcsi.rate import Format, Rate
from tests.feit_records import rate_word, record


def test_rows_are_of_the_chains_that_the_rate_names() -> None:
    word = rate_word(Format.HE, 80) & ~(0b11 << 14)
    assert record(n_rx=2).antennas == (0, 1)
    assert replace(record(n_rx=1), rate=Rate(word | 1 << 15)).antennas == (1,)
    assert replace(record(n_rx=2), rate=Rate(word | 1 << 15)).antennas == (0, 1), "a word that contradicts the shape"


def test_each_row_of_the_channel_has_its_frequency() -> None:
    one = record(Format.VHT, 80, n_rx=2, n_tx=2)
    assert one.csi.shape == (len(one.subcarrier_hz), one.n_rx, one.n_tx) == (242, 2, 2)
    assert one.subcarrier_hz[0] == -one.subcarrier_hz[-1] == -122 * 312_500.0


@pytest.mark.parametrize(
    ("rssi_dbm", "power_dbm"),
    [((-40, -40), -40 + 10 * math.log10(2)), ((-40, 0), -40.0), ((0, -55), -55.0), ((0, 0), -math.inf)],
)
def test_power_is_that_of_all_chains_that_heard(rssi_dbm: tuple[int, int], power_dbm: float) -> None:
    assert replace(record(), rssi_dbm=rssi_dbm).power_dbm == pytest.approx(power_dbm)
