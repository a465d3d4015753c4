"""Scores by factorised back-projection, against each direction by itself."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, circle, weave
from wsr.backprojection import Rows, score_rows
from wsr.focus import sphere_grid
from wsr.geometry import direction
from wsr.ofdm import GRID_5300
from wsr.subapertures import SubApertures, score, sub_apertures

SCALES = (1, 2, 4, 8)
RANGES_M = (2.0, 7.0, 30.0, None)
AZIMUTH, POLAR, FIRST = sphere_grid(math.radians(2.0))
U = direction(AZIMUTH, POLAR)
ROWS = Rows(POLAR[FIRST[:-1]], FIRST)


def _parts(p_m: NDArray[np.float64], segment: NDArray[np.int64] | None = None) -> SubApertures:
    """What a source at 4 m and a weaker echo from elsewhere, 3 m longer, give at all subcarriers."""
    sources_m = p_m.mean(axis=0) + np.array([[3.2, 2.2, -1.0], [-5.0, 4.5, 2.0]])
    d_m = np.linalg.norm(p_m[:, None] - sources_m, axis=2)
    waves = np.exp(-2j * math.pi * d_m[..., None] * (1.0 / WAVELENGTH_M + GRID_5300.hz / 299_792_458.0))
    channel = waves[:, 0] + 0.5 * waves[:, 1]
    where = np.zeros(len(p_m), np.int64) if segment is None else segment
    return sub_apertures(p_m, channel, where, WAVELENGTH_M, SCALES, resign=False, share=0.99, grid=GRID_5300)


@pytest.mark.parametrize("p_m", [weave(210)[1], circle(400)[1], weave(1500)[1]], ids=["short", "flat", "dense"])
@pytest.mark.parametrize("delay_ns", [None, 8.0])
def test_the_same_as_each_direction_by_itself(p_m: NDArray[np.float64], delay_ns: float | None) -> None:
    parts = _parts(p_m)
    slow, fast = score(parts, U, RANGES_M, delay_ns), score_rows(parts, U, ROWS, RANGES_M, delay_ns)
    for exact, quick in ((slow.score, fast.score), (slow.coherence, fast.coherence)):
        off = np.abs(exact - quick).max(axis=(1, 2)) / exact.max(axis=(1, 2))
        assert np.all(off < 2e-3)


def test_segments_keep_their_own_sums() -> None:
    _, p_m = weave(300)
    parts = _parts(p_m, np.searchsorted([70, 75, 200], np.arange(300), "right"))
    slow, fast = score(parts, U, RANGES_M, 8.0), score_rows(parts, U, ROWS, RANGES_M, 8.0)
    assert np.abs(slow.score - fast.score).max() < 2e-3


def test_a_path_too_large_for_its_range_is_summed_directly() -> None:
    """From inside the aperture a leaf turns too fast to be interpolated: to the last bit the direct sum."""
    _, p_m = weave(300)
    parts = _parts(4.0 * p_m)
    slow, fast = score(parts, U, (2.0,), 8.0), score_rows(parts, U, ROWS, (2.0,), 8.0)
    assert np.array_equal(slow.score, fast.score)


def test_the_grid_from_pole_to_pole_is_one_of_even_rows() -> None:
    for t, (begin, end) in enumerate(itertools.pairwise(FIRST)):
        assert np.all(POLAR[begin:end] == ROWS.polar_rad[t])
        even = -math.pi + 2 * math.pi * np.arange(end - begin) / (end - begin)
        assert np.abs(AZIMUTH[begin:end] - even).max() < 1e-12
