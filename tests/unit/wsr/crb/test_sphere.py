"""The bound of many directions, in closed form and of near sources, each against the scalar bound or derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, weave
from wsr.crb import Phase, closed_forms, crb, fim
from wsr.crb.sphere import crb_over, scatter_factor
from wsr.geometry import direction
from wsr.uncertainty import bound

Array = NDArray[np.float64]

_GRID = np.meshgrid(np.arange(-170, 180, 31), np.arange(3, 180, 28))
AZIMUTH, POLAR = (np.radians(a.ravel()) for a in _GRID)
TAU = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
PHASES: tuple[Phase, Phase] = ("known", "unknown")


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("round_trip", [True, False])
def test_many_directions_are_the_scalar_bound_each(phase: Phase, round_trip: bool) -> None:
    chi, variance = weave(70)[1] - weave(70)[1].mean(axis=0), np.linspace(0.1, 0.5, 70)
    factor = scatter_factor(chi, WAVELENGTH_M, variance, phase, round_trip)
    field = crb_over(factor, AZIMUTH, POLAR)
    for i, (azimuth, polar) in enumerate(zip(AZIMUTH.tolist(), POLAR.tolist(), strict=True)):
        one = crb(chi, WAVELENGTH_M, azimuth, polar, variance, phase, round_trip)
        single = fim(chi, WAVELENGTH_M, azimuth, polar, variance, phase, round_trip)
        assert field.azimuth_rad2[i] == pytest.approx(one.azimuth_rad2, rel=1e-8)
        assert field.polar_rad2[i] == pytest.approx(one.polar_rad2, rel=1e-8)
        assert field.covariance_rad2[i] == pytest.approx(one.covariance_rad2, rel=1e-6, abs=1e-12)
        assert field.great_circle_rad2[i] == pytest.approx(one.great_circle_rad**2, rel=1e-8)
        assert field.polar_alone_rad2[i] == pytest.approx(1 / single[1, 1])
        assert field.azimuth_alone_rad2[i] == pytest.approx(1 / single[0, 0])


def test_line_is_infinite_jointly_and_finite_apart() -> None:
    chi = np.linspace(-0.5, 0.5, 100)[:, None] * np.array([0.6, 0.8, 0.0])
    for positions in (chi, (chi + 3.0).astype(np.float32).astype(np.float64)):
        field = crb_over(scatter_factor(positions, WAVELENGTH_M), AZIMUTH, POLAR)
        assert np.isinf([field.great_circle_rad2, field.azimuth_rad2, field.polar_rad2]).all()
        assert not field.covariance_rad2.any()
        assert np.isfinite(field.azimuth_alone_rad2).all()
        assert np.isfinite(field.polar_alone_rad2).all()
    across = crb_over(scatter_factor(chi, WAVELENGTH_M), 0.8, math.pi / 2)
    assert np.isfinite(across.azimuth_rad2[0])
    assert np.isinf(across.polar_rad2[0])
    assert np.isinf(across.polar_alone_rad2[0])


@pytest.mark.parametrize("phase", PHASES)
def test_line_seen_end_on_measures_nothing(phase: Phase) -> None:
    """What rounding leaves of its lengths is no information."""
    line = np.linspace(0.0, 1.0, 50)[:, None] * direction(0.3, 1.0)
    field = crb_over(scatter_factor(line, WAVELENGTH_M, 1.0, phase), 0.3, 1.0)
    assert np.isinf([field.azimuth_rad2, field.polar_rad2, field.azimuth_alone_rad2, field.polar_alone_rad2]).all()
    east = crb_over(scatter_factor(line @ np.diag([1.0, 0.0, 0.0]), WAVELENGTH_M, 1.0, phase), 0.0, math.pi / 2)
    assert np.isinf([east.azimuth_rad2, east.polar_rad2]).all()


def test_no_motion_one_packet_and_the_poles() -> None:
    for packets in (1, 2, 5):
        still = crb_over(scatter_factor(np.ones((packets, 3)), WAVELENGTH_M), AZIMUTH, POLAR)
        assert np.isinf(still.great_circle_rad2).all()
    pole = crb_over(scatter_factor(weave(50)[1], WAVELENGTH_M), [0.3, 1.0], [0.0, math.pi])
    assert np.isinf(pole.azimuth_rad2).all()
    assert np.isfinite(pole.great_circle_rad2).all()


@pytest.mark.parametrize("phase", PHASES)
def test_closed_forms_are_means_over_the_path(phase: Phase) -> None:
    radius, directions = 0.35, list(zip(AZIMUTH.tolist(), POLAR.tolist(), strict=True))
    helix_m, circle_m = radius * direction(TAU, TAU), radius * direction(TAU, np.pi / 2)
    along, length = direction(0.4, 1.0), 2.0
    line_m = length * (np.arange(4096)[:, None] + 0.5) / 4096 * along
    for chi, closed in (
        (helix_m, closed_forms.helix(radius, WAVELENGTH_M, AZIMUTH, POLAR, phase)),
        (circle_m, closed_forms.circle(radius, WAVELENGTH_M, AZIMUTH, POLAR)),
        (line_m, closed_forms.line(length, along, WAVELENGTH_M, AZIMUTH, POLAR, phase)),
    ):
        mean = np.array([fim(chi, WAVELENGTH_M, p, t, 1.0, phase, round_trip=False) for p, t in directions]) / len(chi)
        size = float(np.abs(mean).max())
        np.testing.assert_allclose(closed.a, mean[:, 1, 1], rtol=1e-6, atol=1e-9 * size)
        np.testing.assert_allclose(closed.b, mean[:, 0, 0], rtol=1e-6, atol=1e-9 * size)
        np.testing.assert_allclose(closed.c, mean[:, 0, 1], rtol=1e-6, atol=1e-9 * size)
    one_way = closed_forms.helix(radius, WAVELENGTH_M, AZIMUTH, POLAR, phase)
    product = closed_forms.helix(radius, WAVELENGTH_M, AZIMUTH, POLAR, phase, round_trip=True)
    np.testing.assert_allclose(product.determinant, 16 * one_way.determinant)
    determinant = closed_forms.line(length, along, WAVELENGTH_M, AZIMUTH, POLAR).determinant
    assert np.abs(determinant).max() < 1e-9 * size**2


def test_near_field_bound_is_the_inverse_of_the_gauss_newton_matrix() -> None:
    """Against numeric derivatives of exact distances; the unknown phase is eliminated by a Schur complement."""
    chi = weave(50)[1] - weave(50)[1].mean(axis=0)
    at = np.array([0.8, 1.1, 3.0])

    def phases(p: Array) -> Array:
        distance = np.linalg.norm(p[2] * direction(p[0], p[1]) - chi, axis=1) - p[2]
        return np.asarray(2 * np.pi / WAVELENGTH_M * distance)

    h = 1e-6
    columns = [(phases(at + h * e) - phases(at - h * e)) / (2 * h) for e in np.eye(3)] + [np.ones(50)]
    full = np.array([[np.sum(a * b) for b in columns] for a in columns])
    full = full[:3, :3] - np.outer(full[:3, 3], full[3, :3]) / full[3, 3]
    near = bound(chi, WAVELENGTH_M, at[0], at[1], at[2], level=False)
    np.testing.assert_allclose(near, np.linalg.inv(full), rtol=1e-4)


def test_near_field_bound_ends_in_the_far_field() -> None:
    """Far off the curvature tells no range, and of the angles what plane waves tell."""
    chi = weave(80)[1] - weave(80)[1].mean(axis=0)
    plane = crb(chi, WAVELENGTH_M, 0.8, 1.1, round_trip=False)
    far = bound(chi, WAVELENGTH_M, 0.8, 1.1, 1e4, level=False)
    assert far[2, 2] > 1e4**2
    assert far[0, 0] == pytest.approx(plane.azimuth_rad2, rel=1e-2)
    assert far[1, 1] == pytest.approx(plane.polar_rad2, rel=1e-2)
    flat = bound(chi, WAVELENGTH_M, 0.8, 1.1, None, level=False)
    assert flat[0, 0] == pytest.approx(plane.azimuth_rad2)
    assert flat[1, 1] == pytest.approx(plane.polar_rad2)
    assert flat[2, 2] == math.inf
