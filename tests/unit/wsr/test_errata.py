"""Where the paper's printed equations are wrong, shown by number. docs/maths.md lists these tests by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.refinement import refine_peak
from tests.unit.wsr.scene import WAVELENGTH_M, circle, far, one_way, round_trip, weave
from wsr.crb import crb, fim
from wsr.geometry import direction, great_circle, rotation_z
from wsr.peaks import find_peaks
from wsr.profile import bartlett_profile

Array = NDArray[np.float64]

R = 0.35
TAU = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
# The paper's letters: theta is the polar angle, phi the azimuth.
SOURCES = [(0.4, 0.3), (1.1, 2.0), (2.2, -1.3), (1.5, -2.9)]


def _spherical(xi: Array | float, varphi: Array | float, radius: float = R) -> Array:
    """Displacements in the paper's coordinates: polar angle xi, azimuth varphi."""
    return np.asarray(radius * direction(varphi, xi))


def _one_way_mean(chi: Array, theta: float, phi: float) -> tuple[float, float, float]:
    """A, B, C as means over the aperture, one-way, phase known."""
    information = fim(chi, WAVELENGTH_M, phi, theta, phase="known", round_trip=False) / len(chi)
    return float(information[1, 1]), float(information[0, 0]), float(information[0, 1])


def _peak(chi: Array, g: NDArray[np.complex128], wavelength_m: float = WAVELENGTH_M) -> tuple[Array, float]:
    found = find_peaks(bartlett_profile(chi, g, wavelength_m), 1)[0]
    azimuth, polar, power = refine_peak(chi, g, wavelength_m, azimuth_rad=found.azimuth_rad, polar_rad=found.polar_rad)
    return direction(azimuth, polar), power


def test_printed_crb_is_not_the_inverse_of_the_fim() -> None:
    """Printed s / (Det A) and s / (Det B); the inverse has s B / Det and s A / Det."""
    theta, phi = 1.1, 0.8
    chi = weave()[1]
    chi = chi - chi.mean(axis=0)
    information = fim(chi, WAVELENGTH_M, phi, theta)
    a, b, c = information[1, 1], information[0, 0], information[0, 1]
    det = a * b - c**2
    bound = crb(chi, WAVELENGTH_M, phi, theta)
    assert bound.polar_rad2 == pytest.approx(b / det)
    assert bound.azimuth_rad2 == pytest.approx(a / det)
    assert bound.polar_rad2 > 1000 / (det * a)  # the printed form does not even have the right unit
    np.testing.assert_allclose(
        [[bound.azimuth_rad2, bound.covariance_rad2], [bound.covariance_rad2, bound.polar_rad2]] @ information,
        np.eye(2),
        atol=1e-9,
    )


def test_round_trip_phase_turns_twice_as_fast() -> None:
    """The steering vector prints 2 pi, the signal model 4 pi: the product needs 4 pi, one channel alone 2 pi."""
    u = np.array([0.6, 0.64, 0.48])
    p = weave()[1]
    chi = p - p.mean(axis=0)
    product, single = round_trip(p, far(p, u)), one_way(p, far(p, u))
    one_way_wavelength_m = 2 * WAVELENGTH_M  # turns the 4 pi of the profile into 2 pi
    right, power = _peak(chi, product)
    assert great_circle(right, u) < 1e-3
    assert power > 0.999
    right, power = _peak(chi, single, one_way_wavelength_m)
    assert great_circle(right, u) < 1e-3
    assert power > 0.999
    assert _peak(chi, product, one_way_wavelength_m)[1] < 0.5
    assert _peak(chi, single)[1] > 0.999 or great_circle(_peak(chi, single)[0], u) > 0.05


def test_printed_bartlett_without_conjugate_finds_the_antipode() -> None:
    u = np.array([0.6, 0.64, 0.48])
    p = weave()[1]
    chi = p - p.mean(axis=0)
    product = round_trip(p, far(p, u))
    assert great_circle(_peak(chi, product)[0], u) < 1e-3
    assert great_circle(_peak(chi, product.conj())[0], -u) < 1e-3


@pytest.mark.parametrize(("theta", "phi"), SOURCES)
def test_helix_closed_forms_as_means(theta: float, phi: float) -> None:
    """On one footing, and by what factor each printed form misses it: A twice, B and C 2 pi times."""
    a, b, c = _one_way_mean(_spherical(TAU, TAU), theta, phi)
    unit = (math.pi * R / WAVELENGTH_M) ** 2
    sin_t, cos_t = math.sin(theta), math.cos(theta)
    mean_a = unit * (2 * sin_t**2 + cos_t**2 * (1 - math.cos(2 * phi) / 2))
    mean_b = unit / 2 * sin_t**2 * (2 + math.cos(2 * phi))
    mean_c = unit * sin_t * cos_t * math.sin(phi) * math.cos(phi)
    np.testing.assert_allclose([a, b, c], [mean_a, mean_b, mean_c], rtol=1e-9)
    printed_a = -unit * (cos_t**2 * math.cos(2 * phi) + math.cos(2 * theta) - 3)
    printed_b = math.pi * unit * sin_t**2 * (math.cos(2 * phi) + 2)
    printed_c = 2 * math.pi * unit * sin_t * cos_t * math.sin(phi) * math.cos(phi)
    np.testing.assert_allclose([printed_a / a, printed_b / b, printed_c / c], [2, 2 * math.pi, 2 * math.pi], rtol=1e-9)


@pytest.mark.parametrize(("theta", "phi"), SOURCES)
def test_printed_helix_determinant_is_not_the_determinant(theta: float, phi: float) -> None:
    """Neither of the printed A, B, C nor of the means."""
    t, p = theta, phi
    unit = (math.pi * R / WAVELENGTH_M) ** 2
    printed_a = -unit * (math.cos(t) ** 2 * math.cos(2 * p) + math.cos(2 * t) - 3)
    printed_b = math.pi * unit * math.sin(t) ** 2 * (math.cos(2 * p) + 2)
    printed_c = 2 * math.pi * unit * math.sin(t) * math.cos(t) * math.sin(p) * math.cos(p)
    bracket = (
        8 * math.cos(2 * (t - p))
        + 8 * math.cos(2 * (t + p))
        + (1 + math.pi) * (math.cos(2 * (t + 2 * p)) + math.cos(2 * (t - 2 * p)))
        - 2 * (math.pi - 9) * math.cos(2 * t)
        - 16 * math.cos(2 * p)
        + 2 * (math.pi + 1) * math.cos(4 * p)
        - 2 * math.pi
        + 50
    )
    printed_det = math.pi / 8 * unit**2 * math.sin(t) ** 2 * bracket
    a, b, c = _one_way_mean(_spherical(TAU, TAU), theta, phi)
    for true_det in (printed_a * printed_b - printed_c**2, a * b - c**2):
        assert abs(printed_det / true_det - 1) > 0.05


def test_helix_is_not_better_in_azimuth_than_the_circle_of_its_radius() -> None:
    """Printed: B of the helix exceeds the circle's by at least pi. As means it is (2 + cos 2 phi) / 4 of it."""
    helix, round_circle = _spherical(TAU, TAU), _spherical(np.pi / 2, TAU)
    for theta, phi in SOURCES:
        ratio = _one_way_mean(helix, theta, phi)[1] / _one_way_mean(round_circle, theta, phi)[1]
        assert ratio == pytest.approx((2 + math.cos(2 * phi)) / 4)
        assert ratio <= 0.75


@pytest.mark.parametrize(("theta", "phi"), SOURCES)
def test_circle_closed_forms_need_the_horizontal_circle(theta: float, phi: float) -> None:
    unit = 2 * (math.pi * R / WAVELENGTH_M) ** 2
    expected = [unit * math.cos(theta) ** 2, unit * math.sin(theta) ** 2, 0.0]
    np.testing.assert_allclose(_one_way_mean(_spherical(np.pi / 2, TAU), theta, phi), expected, atol=1e-9 * unit)
    printed = _one_way_mean(_spherical(TAU, np.pi / 2), theta, phi)  # xi = tau, varphi = pi / 2 stands upright
    assert np.abs(np.array(printed) - expected).max() > 0.1 * unit


def test_printed_cross_term_lost_its_minus() -> None:
    """da/dphi carries a minus, the product of it with da/dtheta does not in print."""
    theta, phi, xi, varphi = 1.1, 0.8, np.linspace(0.3, 2.0, 50), np.linspace(-1.0, 2.5, 50)
    wavenumber = 2 * np.pi * R / WAVELENGTH_M
    by_theta = np.cos(theta) * np.sin(xi) * np.cos(phi - varphi) - np.cos(xi) * np.sin(theta)
    by_phi = np.sin(theta) * np.sin(xi) * np.sin(phi - varphi)
    printed = float(np.sum(wavenumber**2 * by_theta * by_phi)) / 50
    assert _one_way_mean(_spherical(xi, varphi), theta, phi)[2] == pytest.approx(-printed)


def test_constant_azimuth_offset_turns_the_peak_and_a_polar_one_does_not() -> None:
    """Lemma 1 is exact for a rotation about z; adding a constant to polar angles is no rotation and defocuses."""
    offset = math.radians(8)
    chi = _spherical(np.linspace(0.5, 2.6, 600), 3 * np.linspace(0.5, 2.6, 600), 0.4)
    u = direction(0.7, 1.2)
    g = np.exp(4j * np.pi / WAVELENGTH_M * chi @ u)
    turned, power = _peak(chi @ rotation_z(offset).T, g)
    assert great_circle(turned, direction(0.7 + offset, 1.2)) < 1e-6
    assert power == pytest.approx(1.0)
    xi = np.linspace(0.5, 2.6, 600) + offset
    shifted, power = _peak(_spherical(xi, 3 * (xi - offset), 0.4), g)
    assert power < 0.9
    for sign in (-1, 1):
        assert great_circle(shifted, direction(0.7, 1.2 + sign * offset)) > math.radians(2)


def test_attenuation_grows_with_radius_over_wavelength() -> None:
    """Lemma 2: the phase deviation is 4 pi rho delta / lambda, not delta: the printed bound breaks, this one holds."""
    delta, radius = math.radians(1.0), 0.3
    t, chi = circle(600, radius)
    del t
    deviation = delta * np.where(np.arange(600) % 2, 1.0, -1.0)
    turned = np.stack([rotation_z(angle) @ row for angle, row in zip(deviation, chi, strict=True)])
    u = direction(0.7, math.pi / 2)
    g = np.exp(4j * np.pi / WAVELENGTH_M * chi @ u)
    amplitude = abs(np.mean(g * np.exp(-4j * np.pi / WAVELENGTH_M * turned @ u)))
    assert amplitude < math.cos(delta / 2) - 0.1
    assert amplitude >= math.cos(4 * np.pi * radius / WAVELENGTH_M * delta)


def test_phase_variance_of_the_product_adds_both_ends() -> None:
    """s_f^2 / (2 |h_f|^2) + s_r^2 / (2 |h_r|^2), with s^2 the power of the complex noise of each end."""
    rng = np.random.default_rng(11)

    def noisy(h: complex, power: float) -> NDArray[np.complex128]:
        noise = rng.normal(size=(2, 200_000)) * math.sqrt(power / 2)
        return np.asarray(h + noise[0] + 1j * noise[1])

    forward, reverse, power_f, power_r = 4.0 + 3.0j, 1.0 - 2.0j, 0.5, 0.05
    product = noisy(forward, power_f) * noisy(reverse, power_r)
    variance = float(np.var(np.angle(product / (forward * reverse))))
    assert variance == pytest.approx(power_f / (2 * 25) + power_r / (2 * 5), rel=0.03)


def test_informativeness_on_the_sphere_needs_the_sine() -> None:
    """1 / (CRB_theta + sin^2 theta CRB_phi): without the sine the poles dominate whatever the aperture."""
    chi = _spherical(TAU, 7 * TAU)
    near_pole, equator = (crb(chi, WAVELENGTH_M, 0.3, theta) for theta in (0.02, math.pi / 2))
    assert near_pole.polar_rad2 + near_pole.azimuth_rad2 > 500 * (equator.polar_rad2 + equator.azimuth_rad2)
    assert near_pole.great_circle_rad < 2 * equator.great_circle_rad


def test_line_has_no_joint_bound() -> None:
    """The paper's line 'quickly inflates'; it is singular for every source, so infinite, not large."""
    chi = _spherical(1.0, 0.4, 1.0) * np.linspace(0.0, 2.0, 100)[:, None]
    for theta, phi in SOURCES:
        assert crb(chi, WAVELENGTH_M, phi, theta, phase="known").great_circle_rad == math.inf
        assert crb(chi, WAVELENGTH_M, phi, theta).great_circle_rad == math.inf


def test_unknown_phase_moves_positions_to_their_centroid() -> None:
    """The helix lies off its origin by r / 2 in y; the printed bound takes that as information."""
    helix = _spherical(TAU, TAU)
    known = fim(helix, WAVELENGTH_M, 0.3, 1.0, phase="known")
    unknown = fim(helix, WAVELENGTH_M, 0.3, 1.0)
    centred = fim(helix - helix.mean(axis=0), WAVELENGTH_M, 0.3, 1.0, phase="known")
    np.testing.assert_allclose(unknown, centred, atol=1e-9 * float(np.trace(known)))
    assert known[0, 0] > 1.2 * unknown[0, 0]
