"""How the path is cut into sub-apertures, and their scores."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, circle, weave
from wsr.focus import sphere_grid
from wsr.geometry import direction
from wsr.ofdm import GRID_5300
from wsr.subapertures import SubApertures, score, score_together, sub_apertures

SCALES = (1, 2, 4, 8)


@pytest.mark.parametrize("bins", [8, 57, 220, 282, 283])
@pytest.mark.parametrize("breaks", [(), (20,), (5, 6, 31)])
def test_every_scale_has_its_number_of_equal_parts(bins: int, breaks: tuple[int, ...]) -> None:
    rng = np.random.default_rng(bins)
    p_m = np.cumsum(rng.normal(size=(bins, 3)), axis=0)
    segment = np.searchsorted([at for at in breaks if at < bins], np.arange(bins), "right")
    parts = sub_apertures(p_m, np.ones((bins, 1), np.complex128), segment, 0.05, scales=SCALES)
    for scale, number in enumerate(SCALES):
        mine = parts.pieces[parts.pieces[:, 0] == scale]
        sizes = [int(mine[mine[:, 1] == part, 4].sum()) for part in range(number)]
        assert sum(sizes) == bins
        assert set(sizes) <= {bins // number, -(-bins // number)}
        for _, part, first, after, size in mine.tolist():
            begin, end = parts.cuts[first], parts.cuts[after]
            assert end - begin == size
            assert len(set(segment[begin:end].tolist())) == 1
            assert begin * number // bins >= part - 1
        # The longest piece of each sub-aperture comes first: the others take their signs from it.
        for part in range(number):
            assert np.all(np.diff(mine[mine[:, 1] == part, 4]) <= 0)


def _parts(p_m: NDArray[np.float64], segment: NDArray[np.int64] | None = None) -> SubApertures:
    """What a source at 4 m and a weaker echo from elsewhere, 3 m longer, give at all subcarriers."""
    sources_m = p_m.mean(axis=0) + np.array([[3.2, 2.2, -1.0], [-5.0, 4.5, 2.0]])
    d_m = np.linalg.norm(p_m[:, None] - sources_m, axis=2)
    waves = np.exp(-2j * math.pi * d_m[..., None] * (1.0 / WAVELENGTH_M + GRID_5300.hz / 299_792_458.0))
    channel = waves[:, 0] + 0.5 * waves[:, 1]
    where = np.zeros(len(p_m), np.int64) if segment is None else segment
    return sub_apertures(p_m, channel, where, WAVELENGTH_M, scales=SCALES, resign=False, share=0.99, grid=GRID_5300)


RANGES_M = (2.0, 7.0, 30.0, None)
U = direction(*sphere_grid(math.radians(4.0))[:2])


@pytest.mark.parametrize("p_m", [weave(210)[1], circle(400)[1], weave(1500)[1]], ids=["short", "flat", "dense"])
@pytest.mark.parametrize("delay_ns", [None, 8.0])
def test_skeletons_of_runs_have_the_same_scores(p_m: NDArray[np.float64], delay_ns: float | None) -> None:
    parts = _parts(p_m)
    fewer = parts.condensed()
    assert fewer.x.shape[1] < 0.8 * parts.x.shape[1]
    slow, fast = score(parts, U, RANGES_M, delay_ns), score(fewer, U, RANGES_M, delay_ns)
    for exact, quick in ((slow.score, fast.score), (slow.coherence, fast.coherence)):
        off = np.abs(exact - quick).max(axis=(1, 2)) / exact.max(axis=(1, 2))
        assert np.all(off < 1e-3)


def test_skeletons_keep_to_their_segments() -> None:
    _, p_m = weave(300)
    parts = _parts(p_m, np.searchsorted([70, 75, 200], np.arange(300), "right"))
    slow, fast = score(parts, U, RANGES_M, 8.0), score(parts.condensed(), U, RANGES_M, 8.0)
    assert np.abs(slow.score - fast.score).max() < 1e-3


def test_parts_that_share_their_bins_are_scored_together() -> None:
    parts = _parts(weave(300)[1])
    columns = (parts.h[0] + 1j * parts.h[1]).T
    ramp = np.exp(1j * np.linspace(0.0, 3.0, len(columns)))[:, None]
    links = parts.with_channels(np.hstack([columns, ramp * columns]))
    for link, together in zip(links, score_together(links, U, RANGES_M, 8.0), strict=True):
        assert np.array_equal(score(link, U, RANGES_M, 8.0).score, together.score)


def test_spherical_waves_are_summed_as_distances_have_it() -> None:
    parts = _parts(weave(300)[1])
    x, h = parts.x.T.astype(float) * WAVELENGTH_M, (parts.h[0] + 1j * parts.h[1]).T
    for range_m in (0.7, 1.2, 2.0, 9.0):
        d = np.linalg.norm(range_m * U[:, None] - x, axis=2) - range_m
        power = (np.abs(np.exp(2j * np.pi / WAVELENGTH_M * d) @ h) ** 2).sum(axis=1)
        exact = power / (parts.power * len(x) ** 2)
        whole = score(parts, U, (range_m,), None).coherence[0, :, 0]
        assert np.abs(whole - exact).max() < 1e-5
