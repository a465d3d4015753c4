"""The variance of a profile."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scenes import helix
from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Profile
from wsr.geometry import direction
from wsr.kernel import bartlett_power
from wsr.profile import bartlett_profile, profile_variance


def test_profile_variance_is_one_without_a_peak_and_small_with_one() -> None:
    flat = Profile(np.ones((180, 360), np.float32), AZIMUTH_RAD, POLAR_RAD)
    assert profile_variance(flat, 0.3, POLAR_RAD[90]) == pytest.approx(1.0, rel=1e-3)
    peaked = Profile(np.full((180, 360), 1e-9, np.float32), AZIMUTH_RAD, POLAR_RAD)
    peaked.power[90, 20] = 1.0
    assert profile_variance(peaked, AZIMUTH_RAD[20], POLAR_RAD[90]) < 0.01


def test_a_profile_is_that_of_the_direct_sum() -> None:
    a = helix(900)
    profile = bartlett_profile(a.chi_m, a.channel, a.wavelength_m)
    direct = bartlett_power(a.chi_m * (2.0 / a.wavelength_m), a.channel / np.abs(a.channel).sum())
    assert np.abs(profile.power - direct).max() < 1e-4 * direct.max()
    assert not profile.undersampled


def test_lobes_between_the_points_of_the_grid_are_found() -> None:
    """A path of 3.5 m across, whose lobe towards a source between two points is 0.4 degrees wide."""
    t = np.linspace(0.0, 12.0 * np.pi, 3000)
    p_m = np.stack([1.75 * np.cos(t), 1.75 * np.sin(t), 0.1 * np.sin(0.5 * t)], axis=-1)
    u = direction(np.deg2rad(40.5), np.deg2rad(90.0))
    profile = bartlett_profile(p_m, np.exp(4j * np.pi / 0.054 * (p_m @ u)), 0.054, cells=True)
    assert not profile.undersampled
    assert profile.power.max() > 0.4
    assert bartlett_profile(p_m, np.exp(4j * np.pi / 0.054 * (p_m @ u)), 0.054).power.max() < 0.2
    row, column = np.unravel_index(np.argmax(profile.power), profile.power.shape)
    assert abs(np.rad2deg(profile.azimuth_rad[column]) - 40.5) <= 0.5 + 1e-9
    assert abs(np.rad2deg(profile.polar_rad[row]) - 90.0) <= 0.5 + 1e-9


def test_a_path_too_long_for_any_grid_says_so() -> None:
    p_m = np.linspace(-6.0, 6.0, 400)[:, None] * np.array([1.0, 0.0, 0.0])
    assert bartlett_profile(p_m, np.ones(400, np.complex128), 0.054, cells=True).undersampled
    assert bartlett_profile(p_m / 4.0, np.ones(400, np.complex128), 0.054).undersampled
    assert not bartlett_profile(p_m / 10.0, np.ones(400, np.complex128), 0.054).undersampled
