"""Grids of subcarriers: the pairs a lag apart, and which channels a grid is known of."""

from __future__ import annotations

import numpy as np
import pytest

from wsr.ofdm import GRID_5300, INDICES_5300_20MHZ, LAG, UNIT_HZ, grid, known


def test_pairs_of_the_5300_are_all_two_units_apart() -> None:
    """Every neighbour but those at the centre and at the upper edge, which are one unit apart."""
    assert GRID_5300.size == 30
    np.testing.assert_array_equal(GRID_5300.k, INDICES_5300_20MHZ)
    assert GRID_5300.lag == LAG
    np.testing.assert_array_equal(GRID_5300.k[GRID_5300.second] - GRID_5300.k[GRID_5300.first], LAG)
    assert GRID_5300.first.size == 27
    assert GRID_5300.bandwidth_hz == 56 * UNIT_HZ


@pytest.mark.parametrize(("spacing_hz", "step"), [(UNIT_HZ / 4, 8), (UNIT_HZ, 2), (2 * UNIT_HZ, 1), (4 * UNIT_HZ, 1)])
def test_the_lag_is_as_near_to_two_units_as_the_grid_has(spacing_hz: float, step: int) -> None:
    on = grid(spacing_hz * np.arange(-20, 21))
    assert on.step == step
    assert on.lag == pytest.approx(step * spacing_hz / UNIT_HZ)
    assert on.first.size == 41 - step


def test_one_subcarrier_has_no_pairs() -> None:
    assert grid([0.0]).first.size == 0
    assert grid([0.0]).bandwidth_hz == 0.0


@pytest.mark.parametrize("hz", [[], [1.0, 1.0], [2.0, 1.0], [0.0, np.nan], [[0.0, 1.0]]])
def test_frequencies_that_do_not_rise_are_refused(hz: object) -> None:
    with pytest.raises(ValueError, match="expected frequencies"):
        grid(np.array(hz))


def test_a_grid_is_known_where_there_is_only_one_it_can_be() -> None:
    assert known(30) is GRID_5300
    assert known(1).size == 1
    wide = grid(UNIT_HZ * np.arange(-100, 101))
    assert known(201, wide) is wide
    with pytest.raises(ValueError, match="56 subcarriers; their frequencies are not given"):
        known(56)
    with pytest.raises(ValueError, match="56 subcarriers; frequencies of 201 are given"):
        known(56, wide)
