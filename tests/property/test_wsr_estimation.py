"""Invariants of pairing, profile, bound and estimate."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.far_field import FarField
from tests.unit.wsr.scene import WAVELENGTH_M, weave
from wsr.aperture import make_aperture
from wsr.channel import pair_by_counter, pair_by_time
from wsr.crb import crb, fim
from wsr.directions import grid
from wsr.geometry import direction, great_circle, rotation_z
from wsr.kernel import bartlett_power

seeds = st.integers(0, 2**32 - 1)
azimuths, polars = st.floats(-3.1, 3.1), st.floats(0.05, 3.09)


@given(st.lists(st.integers(0, 2**32 - 1), max_size=30), st.lists(st.integers(0, 2**32 - 1), max_size=30), seeds)
def test_pairs_by_counter_are_all_and_only_the_unambiguous(a: list[int], b: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    b = [*b, *rng.permutation(np.array(a, np.int64))[::2].tolist()]
    i, j = pair_by_counter(a, b)
    expected = [(k, b.index(value)) for k, value in enumerate(a) if a.count(value) == b.count(value) == 1]
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == expected


@given(seeds, st.floats(0, 0.01), st.floats(0, 0.02))
def test_pairs_by_time_are_in_range_and_one_to_one(seed: int, low: float, width: float) -> None:
    rng = np.random.default_rng(seed)
    forward, reverse = rng.uniform(0, 1, 40), rng.uniform(0, 1, 60)
    i, j = pair_by_time(forward, reverse, low, low + width)
    lag = reverse[j] - forward[i]
    assert np.all((lag >= low) & (lag <= low + width + 1e-12))
    assert len(set(i.tolist())) == len(i)
    assert len(set(j.tolist())) == len(j)
    assert np.all(np.diff(forward[i]) >= 0)


@given(seeds, st.integers(1, 40))
def test_kernel_is_the_defining_sum(seed: int, packets: int) -> None:
    rng = np.random.default_rng(seed)
    chi = rng.normal(scale=rng.uniform(0.01, 50), size=(packets, 3))
    g = rng.normal(size=packets) + 1j * rng.normal(size=packets)
    g /= np.abs(g).sum()
    azimuth, polar = grid(12)
    exact = np.abs(np.exp(-2j * np.pi * (direction(azimuth[None, :], polar[:, None]) @ chi.T)) @ g) ** 2
    np.testing.assert_allclose(bartlett_power(chi, g, 12), exact, atol=4e-6)


@given(seeds, azimuths, polars)
def test_information_is_symmetric_not_negative_and_less_without_the_phase(
    seed: int, azimuth: float, polar: float
) -> None:
    rng = np.random.default_rng(seed)
    chi, variance = rng.normal(size=(30, 3)), rng.uniform(0.01, 1, 30)
    known = fim(chi, WAVELENGTH_M, azimuth, polar, phase_variance_rad2=variance, phase="known")
    unknown = fim(chi, WAVELENGTH_M, azimuth, polar, phase_variance_rad2=variance)
    np.testing.assert_allclose(known, known.T)
    scale = float(np.trace(known))
    assert np.linalg.eigvalsh(unknown).min() >= -1e-9 * scale
    assert np.linalg.eigvalsh(known - unknown).min() >= -1e-9 * scale


@given(seeds, azimuths, polars, st.floats(-3, 3))
def test_bound_turns_with_aperture_and_source(seed: int, azimuth: float, polar: float, yaw: float) -> None:
    chi = np.random.default_rng(seed).normal(size=(30, 3))
    here = crb(chi, WAVELENGTH_M, azimuth, polar)
    turned = crb(chi @ rotation_z(yaw).T, WAVELENGTH_M, azimuth + yaw, polar)
    np.testing.assert_allclose(
        [here.azimuth_rad2, here.polar_rad2, here.great_circle_rad],
        [turned.azimuth_rad2, turned.polar_rad2, turned.great_circle_rad],
        rtol=1e-6,
    )


@given(azimuths, polars, st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=25, deadline=None)
def test_estimate_turns_with_the_world_and_ignores_common_phase_and_scale(
    azimuth: float, polar: float, yaw: float, phase: float
) -> None:
    t, p = weave(120)
    u = direction(azimuth, polar)
    g = np.exp(4j * np.pi / WAVELENGTH_M * (p @ u))
    turn = rotation_z(yaw)
    estimate, _ = FarField().estimate(make_aperture(t, p @ turn.T, 1e-4 * np.exp(1j * phase) * g, WAVELENGTH_M))
    assert great_circle(direction(estimate.azimuth_rad, estimate.polar_rad), turn @ u) < 1e-4
