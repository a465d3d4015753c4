"""How many sources there are."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from tests.unit.wsr.estimators.two_sources import APART, exchanged
from tests.unit.wsr.scene import WAVELENGTH_M, far, weave
from wsr.estimators.music import Music
from wsr.estimators.source_number import source_number
from wsr.estimators.stretches import cut
from wsr.path_bins import Bins


@pytest.mark.parametrize("sources", [1, 2])
def test_mdl_counts_the_sources(sources: int) -> None:
    """Up to four could be told; the packets' own delays, left in, would count as more."""
    counts: Counter[int] = Counter()
    _, p = weave(400)
    for seed in range(10):
        places = tuple(far(p, u) for u in APART[:sources])
        estimate, _ = Music(max_sources=4).estimate(exchanged(p, places, seed))
        counts[len(estimate.paths)] += 1
    assert counts[sources] >= 9


def test_more_sources_than_half_the_dimension_are_never_claimed() -> None:
    rng = np.random.default_rng(3)
    p = np.cumsum(np.full((6, 3), 0.006), axis=0)
    channel = rng.normal(size=(6, 30)) + 1j * rng.normal(size=(6, 30))
    channel *= np.array([1e3, 1e2, 1e1, 1e1, 1.0, 1.0])[:, None]
    bins = Bins(p_m=p, channel=channel, counts=np.ones(6, np.int64), segment=np.zeros(6, np.int64), weights=np.ones(6))
    assert source_number(cut(bins, 16, WAVELENGTH_M), 5) == 3
