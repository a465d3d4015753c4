"""Stretches of a path, and what paths from given directions explain of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, Array, Complex, weave
from wsr.errors import ApertureError
from wsr.estimators.stretches import cut, left_over, likeness, path_powers, whole_coherence
from wsr.geometry import direction
from wsr.path_bins import Bins

P_M = np.asarray(weave(120)[1])
U, V = direction(0.5, 1.4), direction(2.5, 1.2)


def _bins(channel: Complex, segment: NDArray[np.signedinteger] | None = None) -> Bins:
    where = np.zeros(len(channel), np.int64) if segment is None else segment.astype(np.int64)
    return Bins(
        p_m=P_M[: len(channel)],
        channel=channel,
        counts=np.ones(len(channel), np.int64),
        segment=where,
        weights=np.ones(len(channel)),
    )


def _waves(*paths: tuple[Array, float]) -> Complex:
    """(B, 8): each path with another phase at each subcarrier."""
    rng = np.random.default_rng(1)
    field = np.zeros((len(P_M), 8), np.complex128)
    for u, amplitude in paths:
        turns = np.exp(2j * np.pi * rng.random(8))
        field += amplitude * np.exp(2j * np.pi / WAVELENGTH_M * (P_M @ u))[:, None] * turns
    return field


def test_stretches_overlap_by_half_and_reach_both_ends() -> None:
    stretches = cut(_bins(_waves((U, 1.0))), 16, WAVELENGTH_M)
    assert len(stretches) == 1 + math.ceil((120 - 16) / 8)
    assert all(s.p_waves.shape == (16, 3) and s.snapshots.shape == (16, 8) for s in stretches)
    np.testing.assert_allclose(stretches[0].p_waves.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_array_equal(stretches[-1].snapshots, _waves((U, 1.0))[-16:])
    assert all(np.all(np.diff(s.eigenvalues) <= 0) for s in stretches)


def test_a_stretch_keeps_to_its_segment_and_short_ones_are_left_out() -> None:
    segment = np.repeat([0, 1, 2], [60, 3, 57])
    channel = np.repeat(segment, 8).reshape(-1, 8).astype(np.complex128)
    found = {float(s.snapshots[0, 0].real) for s in cut(_bins(channel, segment), 16, WAVELENGTH_M)}
    assert found == {0.0, 2.0}


def test_pieces_of_three_places_are_refused() -> None:
    segment = np.arange(12) // 3
    with pytest.raises(ApertureError, match="12 places in 4 pieces between jumps; needs a piece of at least 4"):
        cut(_bins(np.ones((12, 1), np.complex128), segment), 16, WAVELENGTH_M)


def test_what_paths_explain() -> None:
    stretches = cut(_bins(_waves((U, 1.0), (V, 0.5))), 16, WAVELENGTH_M)
    assert left_over(stretches, np.array([U, V])) == pytest.approx(0.0, abs=1e-9)
    assert left_over(stretches, np.array([U])) == pytest.approx(0.2, abs=0.08)
    powers = path_powers(stretches, np.array([U, V]))
    assert powers[1] / powers[0] == pytest.approx(0.25, rel=0.05)
    assert path_powers(cut(_bins(_waves((U, 1.0))), 16, WAVELENGTH_M), np.array([U])) == pytest.approx([1.0])


def test_likeness_is_one_for_the_same_direction_only() -> None:
    stretches = cut(_bins(_waves((U, 1.0))), 16, WAVELENGTH_M)
    assert likeness(stretches, U, U) == pytest.approx(1.0)
    assert likeness(stretches, U, V) < 0.5


def test_a_broken_chain_of_signs_is_joined() -> None:
    segment = np.repeat([0, 1, 2], [50, 40, 30])
    turned = _waves((U, 1.0)) * np.repeat([1.0, -1.0, 1.0], [50, 40, 30])[:, None]
    assert whole_coherence(_bins(turned, segment), U, WAVELENGTH_M) == pytest.approx(1.0)
    assert whole_coherence(_bins(turned), U, WAVELENGTH_M) < 0.5
    assert whole_coherence(_bins(0 * turned), U, WAVELENGTH_M) == 0.0
