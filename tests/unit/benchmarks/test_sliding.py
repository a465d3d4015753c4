"""A sliding window gives the profile of the packets that are in it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.oracle import bartlett_profile_oracle
from benchmarks.sliding import SlidingProfile
from tests.unit.wsr.scene import WAVELENGTH_M
from wsr.kernel import _FEW
from wsr.profile import bartlett_profile


def packets(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(scale=0.4, size=(count, 3)), np.exp(1j * rng.uniform(-np.pi, np.pi, count))


@pytest.mark.parametrize("batch", [3, *(pytest.param(n, marks=pytest.mark.long) for n in (1, 32, _FEW, _FEW + 1))])
def test_batches_add_up_to_the_whole(batch: int) -> None:
    chi, g = packets(250)
    window = SlidingProfile(WAVELENGTH_M)
    for start in range(0, len(g), batch):
        window.add(chi[start : start + batch], g[start : start + batch])
    exact = bartlett_profile_oracle(chi, g, WAVELENGTH_M)
    assert np.abs(window.profile().power - exact.power).max() < 1e-6


def test_what_left_is_gone() -> None:
    chi, g = packets(400)
    window = SlidingProfile(WAVELENGTH_M)
    for start in range(0, 400, 32):
        window.add(chi[start : start + 32], g[start : start + 32])
        if start >= 64:
            window.remove(chi[start - 64 : start - 32], g[start - 64 : start - 32])
    left = slice(352, 400)
    exact = bartlett_profile(chi[left], g[left], WAVELENGTH_M)
    assert np.abs(window.profile().power - exact.power).max() < 1e-5


def test_the_fixed_point_does_not_matter() -> None:
    chi, g = packets(100)
    here, there = SlidingProfile(WAVELENGTH_M), SlidingProfile(WAVELENGTH_M)
    here.add(chi, g)
    there.add(chi + np.array([3.0, -2.0, 1.0]), g)
    np.testing.assert_allclose(here.profile().power, there.profile().power, atol=1e-5)
