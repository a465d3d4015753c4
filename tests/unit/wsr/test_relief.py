"""Prominences and widths against what they are by definition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from wsr.relief import prominences, width_rad

_ROWS, _COLUMNS = 12, 24
_RESOLVED = 1 / 8000


def _beside(row: int, column: int, rows: int) -> list[tuple[int, int]]:
    """Neighbours of a cell, over a pole those half a turn away."""
    cells = []
    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            r, c = row + dr, column + dc
            if rows > 1 and not 0 <= r < rows:
                r, c = row, c + _COLUMNS // 2
            if (dr or dc) and 0 <= r < rows:
                cells.append((r, c % _COLUMNS))
    return cells


def _flooded(power: NDArray[np.float32], start: tuple[int, int], level: float) -> set[tuple[int, int]]:
    """All that can be reached from a cell without coming below a level."""
    found, front = {start}, [start]
    while front:
        for cell in _beside(*front.pop(), power.shape[0]):
            if cell not in found and power[cell] >= level:
                found.add(cell)
                front.append(cell)
    return found


def _by_definition(power: NDArray[np.float32], peak: tuple[int, int]) -> float:
    """The smallest descent from which there is a way to higher ground."""
    for level in sorted({float(value) for value in power.ravel() if value <= power[peak]}, reverse=True):
        if any(power[cell] > power[peak] for cell in _flooded(power, peak, level)):
            return float(power[peak]) - level
    return float(power[peak] - power.min())


@pytest.mark.parametrize("rows", [1, _ROWS])
@pytest.mark.parametrize("seed", [0])
def test_a_prominence_is_the_least_descent_on_the_way_to_higher_ground(rows: int, seed: int) -> None:
    power = np.random.default_rng(seed).uniform(size=(rows, _COLUMNS)).astype(np.float32)
    found = prominences(power)
    for row in range(rows):
        for column in range(_COLUMNS):
            cell = row, column
            is_peak = all(power[beside] < power[cell] for beside in _beside(*cell, rows))
            expected = _by_definition(power, cell) if is_peak else 0.0
            assert found[cell] == pytest.approx(expected, abs=2 * _RESOLVED), cell


def test_a_plain_has_no_prominence() -> None:
    assert not prominences(np.full((_ROWS, _COLUMNS), 0.5, np.float32)).any()


def test_a_disc_is_as_wide_as_it_is_wherever_it_lies() -> None:
    rows, columns = 180, 360
    polar, azimuth = (np.arange(rows) + 0.5) * math.pi / rows, np.arange(columns) * math.pi / rows
    for at in (0.4, math.pi / 2, 3.0):
        cosine = np.cos(polar)[:, None] * math.cos(at) + np.sin(polar)[:, None] * math.sin(at) * np.cos(azimuth)
        power = np.where(np.arccos(np.clip(cosine, -1, 1)) < 0.15, 1.0, 0.1).astype(np.float32)
        assert width_rad(power, int(at / math.pi * rows), 0) == pytest.approx(0.3, abs=0.01)
    ring = np.where(np.abs(np.arange(360) - 180) <= 5, 1.0, 0.1).astype(np.float32)[None, :]
    assert width_rad(ring, 0, 180) == pytest.approx(math.radians(11))


def test_another_peak_as_high_does_not_count_where_a_valley_lies_between() -> None:
    ring = np.full((1, 360), 0.1, np.float32)
    ring[0, 10:13] = ring[0, 200:230] = 1.0
    assert width_rad(ring, 0, 11) == pytest.approx(math.radians(3))
