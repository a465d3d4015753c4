"""Bands of channels: what a number stands for."""

from __future__ import annotations

import numpy as np
import pytest

from companion.neighbours.bands import OF_5300, coefficients_of, grid_of, name_of
from csi_bridge.feitcsi.channel import thinned
from csi_bridge.feitcsi.rate import Format
from tests.feit_records import KINDS, record
from wsr.ofdm import GRID_5300


@pytest.mark.parametrize("kind", [*KINDS, (Format.HE, 80), (Format.HE, 160)])
def test_a_records_band_stands_for_its_thinned_subcarriers(kind: tuple[Format, int]) -> None:
    one = record(*kind)
    band = one.rate.layout
    assert np.allclose(grid_of(band).hz, thinned(one)[1])
    assert name_of(band) == str(one.rate)


def test_numbers_of_coefficients_go_by_the_width() -> None:
    assert grid_of(OF_5300) is GRID_5300
    widths = [coefficients_of(record(Format.HE, width).rate.layout) for width in (20, 80, 160)]
    assert [coefficients_of(OF_5300), *widths] == [8, 8, 26, 50]
    for nothing in (1 << 3, 0x3F, 64, -1):
        with pytest.raises(ValueError, match="none that a card reports"):
            grid_of(nothing)
