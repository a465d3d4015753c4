"""Profiles made of coarser looks, and the peaks of circles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, circle
from wsr.directions import AZIMUTH_RAD, POLAR_RAD
from wsr.focus import Look, circle_grid, sphere_grid
from wsr.geometry import direction, great_circle
from wsr.kernel import bartlett_power
from wsr.pictures import level_profile, look_profile, ring_peaks

_STEP_RAD = math.radians(2.0)


def _seen(grid: tuple[np.ndarray, np.ndarray, np.ndarray], *bumps: tuple[float, float, float]) -> Look:
    """A look with smooth bumps (azimuth deg, polar deg, height)."""
    azimuth, polar, rows = grid
    units, power = direction(azimuth, polar), np.zeros(azimuth.size)
    for azimuth_deg, polar_deg, height in bumps:
        centre = direction(math.radians(azimuth_deg), math.radians(polar_deg))
        power = np.maximum(power, height * np.exp(-((great_circle(units, centre) / 0.2) ** 2)))
    return Look(
        azimuth_rad=azimuth, polar_rad=polar, units=units, combined=power[:, None], power=power, peak=np.ones(1),
        ranges_m=(None,), rows=rows,
    )  # fmt: skip


@pytest.mark.parametrize(("azimuth_deg", "polar_deg"), [(40.0, 80.0), (-179.6, 100.0), (10.0, 4.0)])
def test_the_profile_of_a_look_has_its_maximum_where_the_look_has(azimuth_deg: float, polar_deg: float) -> None:
    profile = look_profile(_seen(sphere_grid(_STEP_RAD), (azimuth_deg, polar_deg, 1.0)))
    assert profile.power.shape == (180, 360)
    row, column = np.unravel_index(np.argmax(profile.power), profile.power.shape)
    found = direction(AZIMUTH_RAD[column], POLAR_RAD[row])
    truth = direction(math.radians(azimuth_deg), math.radians(polar_deg))
    assert great_circle(found, truth) < 1.5 * _STEP_RAD
    assert profile.power.max() == pytest.approx(1.0, abs=0.05)


def test_the_profile_of_a_level_path_is_that_of_every_direction() -> None:
    _, p = circle(200)
    wave = np.exp(2j * np.pi / WAVELENGTH_M * (p @ direction(0.7, 1.3))).astype(np.complex128)
    profile = level_profile(p, wave, WAVELENGTH_M)
    whole = bartlett_power(p / WAVELENGTH_M, wave / np.abs(wave).sum())
    off = np.abs(profile.power - whole / whole.max())
    assert off.max() < 0.15
    assert off.mean() < 0.01
    row, column = np.unravel_index(np.argmax(profile.power), profile.power.shape)
    assert abs(math.degrees(AZIMUTH_RAD[column] - 0.7)) < 1.0
    assert abs(math.degrees(abs(POLAR_RAD[row] - math.pi / 2) - (math.pi / 2 - 1.3))) < 2.0  # or its mirror image


def test_peaks_of_a_ring_by_azimuth_at_their_best_polar_angle() -> None:
    polars = (math.radians(80.0), math.radians(66.0))
    seen = _seen(circle_grid(_STEP_RAD, polars), (30.0, 80.0, 1.0), (-100.0, 66.0, 0.6), (36.0, 66.0, 0.9))
    first, second = ring_peaks(seen, 5)
    assert (math.degrees(first.azimuth_rad), math.degrees(second.azimuth_rad)) == pytest.approx((30.0, -100.0))
    assert (first.polar_rad, second.polar_rad) == polars
    assert (first.relative_power, second.relative_power) == pytest.approx((1.0, 0.6), abs=1e-3)
    assert second.prominence == pytest.approx(0.6, abs=0.01)
    assert ring_peaks(seen, 1) == (first,)


def test_a_flat_ring_has_one_peak_at_least() -> None:
    seen = _seen(circle_grid(_STEP_RAD, (1.4,)))
    level = Look(**{name: getattr(seen, name) for name in seen.__slots__} | {"power": np.ones(seen.power.size)})
    assert len(ring_peaks(level, 1)) == 1
