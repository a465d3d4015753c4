"""A peak between the points of the grid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.refinement import refine_peak
from tests.unit.wsr.scene import WAVELENGTH_M, far, round_trip, weave
from wsr.geometry import direction, great_circle
from wsr.peaks import find_peaks
from wsr.profile import bartlett_profile


@pytest.mark.parametrize(("azimuth_deg", "polar_deg"), [(33.37, 71.81), (-179.6, 90.2), (12.0, 0.2), (-75.5, 178.9)])
def test_refined_peak_is_exact_between_grid_points(azimuth_deg: float, polar_deg: float) -> None:
    u = direction(math.radians(azimuth_deg), math.radians(polar_deg))
    _, p = weave()
    chi, g = p - p.mean(axis=0), round_trip(p, far(p, u, 1e7))
    grid_peak = find_peaks(bartlett_profile(chi, g, WAVELENGTH_M), 1)[0]
    azimuth, polar, power = refine_peak(
        chi, g, WAVELENGTH_M, azimuth_rad=grid_peak.azimuth_rad, polar_rad=grid_peak.polar_rad
    )
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
        azimuth, polar, power = refine_peak(chi, g, WAVELENGTH_M, azimuth_rad=azimuth0, polar_rad=polar0)
        assert power == pytest.approx(_power(chi, g, azimuth, polar), rel=1e-9)
        assert power >= _power(chi, g, azimuth0, polar0)
        near = 1e-4 / scale
        ring = [_power(chi, g, azimuth + a, polar + b) for a in (-near, 0, near) for b in (-near, 0, near)]
        assert power >= max(ring) * (1 - 1e-9)


def test_refinement_stays_on_a_ridge() -> None:
    """A straight aperture says nothing across itself: the start may not drift along the ridge."""
    chi = np.linspace(-0.5, 0.5, 200)[:, None] * np.array([1.0, 0.0, 0.0])
    g = np.exp(4j * np.pi / WAVELENGTH_M * chi @ direction(1.0, math.pi / 2))
    azimuth, polar, _ = refine_peak(chi, g, WAVELENGTH_M, azimuth_rad=1.004, polar_rad=math.pi / 2 + 0.01)
    assert math.degrees(abs(polar - math.pi / 2)) < 1.0
    assert math.acos(direction(azimuth, polar)[0]) == pytest.approx(1.0, abs=1e-5)


def _power(chi: np.ndarray[tuple[int, int], np.dtype[np.float64]], g: object, azimuth: float, polar: float) -> float:
    channel = np.asarray(g, np.complex128)
    phase = 4 * np.pi / WAVELENGTH_M * chi @ direction(azimuth, polar)
    return float(np.abs(np.sum(channel * np.exp(-1j * phase))) ** 2 / np.abs(channel).sum() ** 2)
