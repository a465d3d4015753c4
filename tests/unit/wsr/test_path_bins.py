"""Bins along the path: each a mean of the packets of one short run of one segment."""

from __future__ import annotations

import numpy as np
import pytest

from wsr.path_bins import path_bins

_RNG = np.random.default_rng(3)
_X_M = np.sort(_RNG.uniform(0.0, 0.3, 200))
_P_M = np.stack([_X_M, np.zeros(200), np.zeros(200)], axis=1)
_H = (_RNG.normal(size=(200, 4)) + 1j * _RNG.normal(size=(200, 4))).astype(np.complex64)
_SEGMENT = np.repeat([0, 1], [120, 80]).astype(np.int64)


def test_bins_are_means_of_the_packets_that_were_kept() -> None:
    keep = _RNG.uniform(size=200) < 0.8
    bins = path_bins(_P_M, _H, keep, _SEGMENT, length_m=0.01)
    assert bins.counts.sum() == keep.sum()
    assert (bins.weights[~keep] == 0).all() and bins.weights.sum() == pytest.approx(len(bins.counts))
    used = np.flatnonzero(keep)
    ends = np.cumsum(bins.counts)
    for at, end, size, segment in zip(range(len(ends)), ends, bins.counts, bins.segment, strict=True):
        mine = used[end - size : end]
        assert np.ptp(_X_M[mine]) <= 0.01
        assert set(_SEGMENT[mine]) == {segment}
        assert bins.p_m[at] == pytest.approx(_P_M[mine].mean(axis=0))
        assert bins.channel[at] == pytest.approx(_H[mine].mean(axis=0), abs=1e-6)


def test_a_mean_of_any_value_is_over_the_same_packets() -> None:
    bins = path_bins(_P_M, _H, np.ones(200, bool), _SEGMENT, length_m=0.02)
    assert bins.means(_X_M) == pytest.approx(bins.p_m[:, 0])


def test_without_a_length_each_packet_is_a_bin() -> None:
    keep = np.arange(200) % 3 != 0
    bins = path_bins(_P_M, _H, keep, _SEGMENT, length_m=None)
    assert (bins.counts == 1).all() and len(bins.counts) == keep.sum()
    assert bins.p_m == pytest.approx(_P_M[keep])


def test_a_robot_that_stands_is_one_bin_however_many_packets_it_sent() -> None:
    standing = np.concatenate([np.zeros((500, 3)), _P_M])
    bins = path_bins(
        standing, np.ones((700, 1), np.complex64), np.ones(700, bool), np.zeros(700, np.int64), length_m=0.005
    )
    assert bins.counts[0] >= 500 and bins.counts[1:].max() < 20
