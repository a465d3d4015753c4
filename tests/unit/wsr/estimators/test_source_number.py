"""How many sources there are."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.unit.wsr.estimators.two_sources import APART, exchanged
from tests.unit.wsr.scene import far, weave
from wsr.estimators.music import Music


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
