"""Peaks on the grid and between its points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Profile
from wsr.geometry import direction, great_circle
from wsr.peaks import find_peaks


def _bumps(*bumps: tuple[float, float, float]) -> Profile:
    """Profile with smooth bumps (azimuth deg, polar deg, height) on the sphere."""
    u = direction(AZIMUTH_RAD[None, :], POLAR_RAD[:, None])
    power = np.zeros((180, 360))
    for azimuth_deg, polar_deg, height in bumps:
        centre = direction(math.radians(azimuth_deg), math.radians(polar_deg))
        power = np.maximum(power, height * np.exp(-((great_circle(u, centre) / 0.1) ** 2)))
    return Profile(power.astype(np.float32), AZIMUTH_RAD, POLAR_RAD)


def test_peaks_come_highest_first_with_relative_power() -> None:
    peaks = find_peaks(_bumps((10, 60.5, 0.4), (-120, 100.5, 0.8), (90, 30.5, 0.2)), 5)
    assert [round(math.degrees(p.azimuth_rad)) for p in peaks] == [-120, 10, 90]
    assert [round(p.relative_power, 3) for p in peaks] == [1.0, 0.5, 0.25]
    assert peaks[0].power == pytest.approx(0.8, rel=1e-3)


def test_one_peak_across_the_azimuth_seam_and_over_a_pole() -> None:
    assert len(find_peaks(_bumps((179.9, 90, 1.0)), 5)) == 1
    assert len(find_peaks(_bumps((30, 0.6, 1.0)), 5, min_separation_rad=0.0)) == 1


def test_ridge_over_the_pole_has_one_summit() -> None:
    """Beside the pole the ridge is higher than all around it in its own half; only across the pole it goes on."""
    u = direction(AZIMUTH_RAD[None, :], POLAR_RAD[:, None])
    power = np.exp(-(((u[..., 0] - 0.1) / 0.1) ** 2) - (u[..., 1] / 0.002) ** 2) * (u[..., 2] > 0)
    assert len(find_peaks(Profile(power.astype(np.float32), AZIMUTH_RAD, POLAR_RAD), 5, 0.0)) == 1


def test_close_peaks_are_one_peak_and_count_limits() -> None:
    profile = _bumps((0, 90.5, 1.0), (17, 90.5, 0.9), (100, 90.5, 0.5), (-100, 90.5, 0.4))
    assert len(find_peaks(profile, 9, math.radians(20))) == 3
    assert len(find_peaks(profile, 9, math.radians(10))) == 4
    assert len(find_peaks(profile, 2)) == 2


def test_silent_profile_has_no_peaks() -> None:
    assert find_peaks(Profile(np.zeros((180, 360), np.float32), AZIMUTH_RAD, POLAR_RAD), 3) == ()
