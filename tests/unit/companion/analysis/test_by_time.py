"""Packets of two cards without counters find each other by their clocks alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from companion.analysis.by_time import pair_by_card_time

Array = npt.NDArray[np.float64]


def exchange(seconds: float, seed: int = 1, skew: float = 5e-6) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Times [us] of answers on our card and pings on theirs, a tenth lost at each end, and of ours what they answer."""
    rng = np.random.default_rng(seed)
    count = round(150 * seconds)
    ping_us = (np.arange(count) + 0.2 * rng.random(count)) / 150 * 1e6
    answer_us = ping_us + 1000 + 100 * rng.normal(size=count)
    ours, theirs = np.flatnonzero(rng.random(count) > 0.1), np.flatnonzero(rng.random(count) > 0.1)
    return answer_us[ours] + 4.2e8, ping_us[theirs] * (1 + skew) + 1.7e9, theirs[:, None] == ours


@pytest.mark.long
def test_packets_of_one_exchange_belong_together_however_long_the_clocks_drift() -> None:
    ours, theirs, same = exchange(90.0)
    i, j = pair_by_card_time(ours, theirs)
    assert len(i) > 0.95 * np.count_nonzero(same.any(axis=0))
    assert same[j, i].all()
    assert len(np.unique(i)) == len(i) and len(np.unique(j)) == len(j)


def test_logs_that_share_little_or_nothing_are_not_joined() -> None:
    ours, theirs, same = exchange(20.0)
    i, j = pair_by_card_time(ours[: len(ours) // 2], theirs[len(theirs) // 4 :])
    assert len(i) and same[j + len(theirs) // 4, i].all()
    for short in (ours[:0], ours[:10]):
        assert not len(pair_by_card_time(short, theirs)[0])


def test_pings_that_are_a_clock_themselves_tell_nothing() -> None:
    even = np.arange(900) / 150 * 1e6
    assert not len(pair_by_card_time(even + 1000, even)[0])
