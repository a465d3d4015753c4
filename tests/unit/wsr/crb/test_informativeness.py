"""Informativeness of an aperture, and what priors make of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, circle, far, round_trip, weave
from wsr.aperture import Aperture, make_aperture
from wsr.crb import crb
from wsr.crb.informativeness import Prior, informativeness, sphere_prior, spread
from wsr.crb.sphere import crb_over, scatter_factor
from wsr.geometry import direction, great_circle

AZIMUTH, POLAR = 0.8, 1.1


def bearing_prior(azimuth_rad: float, polar_rad: float, std_rad: float) -> Prior:
    """Around an earlier bearing: weights exp((cos d - 1) / std^2) times the solid angle, d the distance on the sphere.

    Far out these vanish and are left out; a bearing much sharper than the grid is its nearest point.
    """
    anywhere = sphere_prior()
    centre = direction(azimuth_rad, polar_rad)
    distance = great_circle(direction(anywhere.azimuth_rad, anywhere.polar_rad), centre)
    exponent = (np.cos(distance) - 1.0) / std_rad**2
    weight = anywhere.weight * np.exp(exponent - exponent.max())
    kept = weight > 1e-6 * weight.max()
    return Prior(anywhere.azimuth_rad[kept], anywhere.polar_rad[kept], weight[kept] / weight[kept].sum())


def _aperture(t_s: NDArray[np.float64], p_m: NDArray[np.float64], noise_rad: float = 0.2) -> Aperture:
    u = direction(AZIMUTH, POLAR)
    return make_aperture(t_s, p_m, round_trip(p_m, far(p_m, u), noise_rad), WAVELENGTH_M)


def test_towards_the_source_it_is_the_bound_at_the_noise_of_the_channel() -> None:
    aperture = _aperture(*weave(600), noise_rad=0.3)
    got = informativeness(aperture, AZIMUTH, POLAR)
    assert got.phase_variance_rad2 == pytest.approx(0.09, rel=0.2)
    at = crb(aperture.chi_m, WAVELENGTH_M, AZIMUTH, POLAR, phase_variance_rad2=got.phase_variance_rad2).great_circle_rad
    assert got.source_per_rad2 == pytest.approx(at**-2, rel=1e-8)
    twice = informativeness(aperture, AZIMUTH, POLAR, phase_variance_rad2=2 * got.phase_variance_rad2)
    assert twice.source_per_rad2 == pytest.approx(got.source_per_rad2 / 2)
    assert twice.worst_per_rad2 == pytest.approx(got.worst_per_rad2 / 2)


def test_worst_case_is_the_least_of_the_grid_and_says_where() -> None:
    aperture = _aperture(*weave(300))
    got = informativeness(aperture, AZIMUTH, POLAR, 0.1)
    grid = sphere_prior()
    values = [
        crb(aperture.chi_m, WAVELENGTH_M, a, p, phase_variance_rad2=0.1).great_circle_rad ** -2
        for a, p in zip(grid.azimuth_rad.tolist(), grid.polar_rad.tolist(), strict=True)
    ]
    assert grid.azimuth_rad.size == 72 * 36
    assert got.worst_per_rad2 == pytest.approx(min(values))
    at = crb(aperture.chi_m, WAVELENGTH_M, got.worst_azimuth_rad, got.worst_polar_rad, phase_variance_rad2=0.1)
    assert at.great_circle_rad**-2 == pytest.approx(min(values))
    assert got.worst_per_rad2 < got.percentile_per_rad2 < got.source_per_rad2 * 100
    share = np.average(np.array(values) >= got.percentile_per_rad2 * (1 - 1e-9), weights=grid.weight)
    assert share == pytest.approx(0.9, abs=0.01)


def test_a_plane_tells_nothing_of_sources_in_it_and_a_line_nothing_at_all() -> None:
    t_s, p_m = circle()
    prior = bearing_prior(AZIMUTH, math.pi / 2, math.radians(0.1))
    plane = informativeness(_aperture(t_s, p_m), AZIMUTH, math.pi / 2, prior=prior)
    assert plane.source_per_rad2 == 0.0
    line = make_aperture(t_s, np.outer(t_s, [0.3, 0.1, 0.0]), np.ones(t_s.size), WAVELENGTH_M)
    nothing = informativeness(line, AZIMUTH, POLAR)
    assert (nothing.source_per_rad2, nothing.worst_per_rad2, nothing.percentile_per_rad2) == (0.0, 0.0, 0.0)


def test_priors_are_weights_around_where_the_source_may_be() -> None:
    anywhere, near = sphere_prior(), bearing_prior(AZIMUTH, POLAR, math.radians(15))
    for prior in (anywhere, near):
        assert prior.weight.sum() == pytest.approx(1.0)
    u = direction(anywhere.azimuth_rad, anywhere.polar_rad)
    np.testing.assert_allclose(anywhere.weight @ u, 0.0, atol=1e-12)
    distance = great_circle(direction(near.azimuth_rad, near.polar_rad), direction(AZIMUTH, POLAR))
    # On the tangent plane a deviation of 15 degrees an axis is 15 sqrt(2) in all.
    assert math.degrees(math.sqrt(near.weight @ distance**2)) == pytest.approx(15 * math.sqrt(2), rel=0.05)
    factor = scatter_factor(weave(200)[1], WAVELENGTH_M)
    assert spread(factor, near).worst_rad2 <= spread(factor, anywhere).worst_rad2


def test_a_planned_path_can_be_asked_before_it_is_flown() -> None:
    """A leg with a weave is worth more than the same leg straight, to a source that guidance knows roughly."""
    flat, woven = weave(200)[1].copy(), weave(200)[1]
    flat[:, 2] = 1.0
    factors = [scatter_factor(path, WAVELENGTH_M) for path in (flat, woven)]
    values = [1.0 / crb_over(factor, AZIMUTH, math.pi / 2).great_circle_rad2[0] for factor in factors]
    assert values[0] == 0.0
    assert values[1] > 100.0
