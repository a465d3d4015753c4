"""The one-way channel from both directions, and its signs."""

from __future__ import annotations

import numpy as np

from tests.unit.wsr.scene import WAVELENGTH_M, exchange, one_way, weave
from wsr.reciprocity import ChainLimits, chain, fold, without_delay

SOURCE = np.array([[9.0, 4.0, 1.5]])
LIMITS = ChainLimits(far_m=WAVELENGTH_M / 3, near_m=WAVELENGTH_M / 12)


def test_fold_is_the_one_way_channel_but_for_its_sign() -> None:
    _, p = weave(300)
    folded = fold(*exchange(p, SOURCE, noise=0.0))
    true = one_way(p, SOURCE)
    off = without_delay(folded.channel).mean(axis=1) * true.conj()
    np.testing.assert_allclose(np.abs(np.sin(np.angle(off**2) / 2)), 0.0, atol=0.02)
    np.testing.assert_allclose(folded.reciprocity, 1.0, atol=1e-5)
    assert 0.2 < np.mean(off.real > 0) < 0.8  # random signs, until they are chained


def test_ends_that_disagree_are_seen() -> None:
    _, p = weave(300)
    forward, _ = exchange(p, SOURCE)
    rng = np.random.default_rng(2)
    wild = (rng.normal(size=(300, 30)) + 1j * rng.normal(size=(300, 30))).astype(np.complex64)
    assert np.median(fold(forward, wild).reciprocity) < 0.5


def test_chain_finds_the_signs() -> None:
    t, p = weave(900)
    h = without_delay(fold(*exchange(p, SOURCE)).channel)
    sign, keep, segment = chain(h, t, p, LIMITS)
    assert keep.all()
    assert not segment.any()
    steady = (h * sign[:, None]).mean(axis=1) * one_way(p, SOURCE).conj()
    assert np.all(steady.real > 0) or np.all(steady.real < 0)


def test_chain_breaks_where_the_path_jumps() -> None:
    t, p = weave(900)
    keep = np.r_[0:420, 510:900]
    forward, reverse = exchange(p, SOURCE)
    h = without_delay(fold(forward, reverse).channel)[keep]
    _, _, segment = chain(h, t[keep], p[keep], LIMITS)
    np.testing.assert_array_equal(segment, np.r_[np.zeros(420), np.ones(390)])


def test_gate_drops_a_wild_packet_and_goes_on() -> None:
    t, p = weave(900)
    h = without_delay(fold(*exchange(p, SOURCE)).channel)
    h[200] *= 1j
    sign, keep, segment = chain(h, t, p, LIMITS)
    np.testing.assert_array_equal(np.flatnonzero(~keep), [200])
    assert not segment.any()
    steady = ((h * sign[:, None]).mean(axis=1) * one_way(p, SOURCE).conj())[keep]
    assert np.all(steady.real > 0) or np.all(steady.real < 0)
