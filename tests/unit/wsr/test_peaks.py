"""Peaks on the grid and between its points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, far, round_trip, weave
from wsr.geometry import direction, great_circle
from wsr.peaks import find_peaks, refine_peak
from wsr.profile import AZIMUTH_RAD, POLAR_RAD, Profile, bartlett_profile


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


@pytest.mark.parametrize(("azimuth_deg", "polar_deg"), [(33.37, 71.81), (-179.6, 90.2), (12.0, 0.2), (-75.5, 178.9)])
def test_refined_peak_is_exact_between_grid_points(azimuth_deg: float, polar_deg: float) -> None:
    u = direction(math.radians(azimuth_deg), math.radians(polar_deg))
    _, p = weave()
    chi, g = p - p.mean(axis=0), round_trip(p, far(p, u, 1e7))
    grid_peak = find_peaks(bartlett_profile(chi, g, WAVELENGTH_M), 1)[0]
    azimuth, polar, power = refine_peak(chi, g, WAVELENGTH_M, grid_peak.azimuth_rad, grid_peak.polar_rad)
    assert math.degrees(great_circle(direction(azimuth, polar), u)) < 1e-3
    assert power == pytest.approx(1.0, abs=1e-6)
    assert grid_peak.power < power
    assert great_circle(direction(grid_peak.azimuth_rad, grid_peak.polar_rad), u) < math.radians(1.0)


@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_refined_power_is_the_profile_at_that_point_and_never_lower_than_the_start(scale: float) -> None:
    """The larger aperture has lobes narrower than the longest step."""
    _, p = weave(200)
    rng = np.random.default_rng(0)
    chi, g = scale * (p - p.mean(axis=0)), np.exp(1j * rng.uniform(-3, 3, 200))
    for azimuth0, polar0 in rng.uniform([-3, 0.2], [3, 2.9], size=(20, 2)):
        azimuth, polar, power = refine_peak(chi, g, WAVELENGTH_M, azimuth0, polar0)
        assert power == pytest.approx(_power(chi, g, azimuth, polar), rel=1e-9)
        assert power >= _power(chi, g, azimuth0, polar0)
        near = 1e-4 / scale
        ring = [_power(chi, g, azimuth + a, polar + b) for a in (-near, 0, near) for b in (-near, 0, near)]
        assert power >= max(ring) * (1 - 1e-9)


def test_refinement_stays_on_a_ridge() -> None:
    """A straight aperture says nothing across itself: the start may not drift along the ridge."""
    chi = np.linspace(-0.5, 0.5, 200)[:, None] * np.array([1.0, 0.0, 0.0])
    g = np.exp(4j * np.pi / WAVELENGTH_M * chi @ direction(1.0, math.pi / 2))
    azimuth, polar, _ = refine_peak(chi, g, WAVELENGTH_M, 1.004, math.pi / 2 + 0.01)
    assert math.degrees(abs(polar - math.pi / 2)) < 1.0
    assert math.acos(direction(azimuth, polar)[0]) == pytest.approx(1.0, abs=1e-5)


def _power(chi: np.ndarray[tuple[int, int], np.dtype[np.float64]], g: object, azimuth: float, polar: float) -> float:
    channel = np.asarray(g, np.complex128)
    phase = 4 * np.pi / WAVELENGTH_M * chi @ direction(azimuth, polar)
    return float(np.abs(np.sum(channel * np.exp(-1j * phase))) ** 2 / np.abs(channel).sum() ** 2)
