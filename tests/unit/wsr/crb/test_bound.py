"""The bound against differentiation, against an estimator that reaches it, and where it must be infinite."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.refinement import refine_peak
from tests.unit.wsr.crb import closed_forms
from tests.unit.wsr.scene import WAVELENGTH_M, circle, far, round_trip, weave
from wsr.crb import Phase, crb, fim
from wsr.geometry import direction, great_circle, wrap_angle

AZIMUTH, POLAR = 0.8, 1.1
_GRID = np.meshgrid(np.arange(-170, 180, 31), np.arange(3, 180, 28))
_AZIMUTHS, _POLARS = (np.radians(a.ravel()) for a in _GRID)
_TAU = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
_PHASES: tuple[Phase, Phase] = ("known", "unknown")


def _line(packets: int = 100) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.asarray(np.linspace(-0.5, 0.5, packets)[:, None] * np.array([0.6, 0.8, 0.0]))


@pytest.mark.parametrize("phase", ["known", "unknown"])
def test_fim_is_the_gauss_newton_matrix_of_the_phases(phase: str) -> None:
    """Against numeric derivatives; an unknown phase is a third parameter, eliminated by a Schur complement."""
    chi = weave(50)[1]
    variance = np.linspace(0.1, 0.5, 50)

    def phases(azimuth: float, polar: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.asarray(4 * np.pi / WAVELENGTH_M * chi @ direction(azimuth, polar))

    h = 1e-6
    columns = [
        (phases(AZIMUTH + h, POLAR) - phases(AZIMUTH - h, POLAR)) / (2 * h),
        (phases(AZIMUTH, POLAR + h) - phases(AZIMUTH, POLAR - h)) / (2 * h),
        np.ones(50),
    ]
    full = np.array([[np.sum(a * b / variance) for b in columns] for a in columns])
    if phase == "known":
        got = fim(chi, WAVELENGTH_M, AZIMUTH, POLAR, phase_variance_rad2=variance, phase="known")
        np.testing.assert_allclose(got, full[:2, :2], rtol=1e-6)
    else:
        got = fim(chi, WAVELENGTH_M, AZIMUTH, POLAR, phase_variance_rad2=variance, phase="unknown")
        schur = full[:2, :2] - np.outer(full[:2, 2], full[2, :2]) / full[2, 2]
        np.testing.assert_allclose(got, schur, rtol=1e-5)


def test_bound_is_the_inverse_and_its_great_circle() -> None:
    chi = weave(80)[1]
    inverse = np.linalg.inv(fim(chi, WAVELENGTH_M, AZIMUTH, POLAR, phase_variance_rad2=0.25))
    bound = crb(chi, WAVELENGTH_M, AZIMUTH, POLAR, phase_variance_rad2=0.25)
    assert bound.azimuth_rad2 == pytest.approx(inverse[0, 0])
    assert bound.polar_rad2 == pytest.approx(inverse[1, 1])
    assert bound.covariance_rad2 == pytest.approx(inverse[0, 1])
    great = math.sqrt(inverse[1, 1] + math.sin(POLAR) ** 2 * inverse[0, 0])
    assert bound.great_circle_rad == pytest.approx(great)


def test_unknown_phase_ignores_where_the_origin_is_and_costs_information() -> None:
    chi = weave(80)[1]
    centred = chi - chi.mean(axis=0)
    here = crb(chi, WAVELENGTH_M, AZIMUTH, POLAR)
    assert here.azimuth_rad2 == pytest.approx(crb(centred, WAVELENGTH_M, AZIMUTH, POLAR).azimuth_rad2)
    assert here.azimuth_rad2 > crb(chi, WAVELENGTH_M, AZIMUTH, POLAR, phase="known").azimuth_rad2
    same = crb(centred, WAVELENGTH_M, AZIMUTH, POLAR, phase="known")
    assert here.polar_rad2 == pytest.approx(same.polar_rad2)


def test_maximum_of_the_profile_reaches_the_bound() -> None:
    """Seeded Monte Carlo with 0.3 rad of noise per packet, over which the phase model is linear."""
    p = weave(150)[1]
    chi, u = p - p.mean(axis=0), direction(AZIMUTH, POLAR)
    clean = round_trip(p, far(p, u, 1e7))
    rng = np.random.default_rng(7)
    errors = []
    for _ in range(300):
        g = clean * np.exp(0.3j * rng.normal(size=150))
        azimuth, polar, _ = refine_peak(chi, g, WAVELENGTH_M, azimuth_rad=AZIMUTH, polar_rad=POLAR)
        errors.append((float(wrap_angle(azimuth - AZIMUTH)), polar - POLAR))
    measured = np.var(np.array(errors), axis=0)
    bound = crb(chi, WAVELENGTH_M, AZIMUTH, POLAR, phase_variance_rad2=0.09)
    np.testing.assert_allclose(measured, [bound.azimuth_rad2, bound.polar_rad2], rtol=0.25)


@pytest.mark.parametrize("phase", ["known", "unknown"])
def test_line_is_singular_jointly(phase: str) -> None:
    bound = crb(_line(), WAVELENGTH_M, AZIMUTH, POLAR, phase="known" if phase == "known" else "unknown")
    assert (bound.azimuth_rad2, bound.polar_rad2, bound.great_circle_rad) == (math.inf, math.inf, math.inf)
    assert bound.covariance_rad2 == 0.0


def test_line_in_single_precision_is_still_a_line() -> None:
    chi = (_line() + 3.0).astype(np.float32).astype(np.float64)
    assert crb(chi, WAVELENGTH_M, AZIMUTH, POLAR).great_circle_rad == math.inf


@pytest.mark.parametrize("phase", ["known", "unknown"])
@pytest.mark.parametrize("off_rad", [0.0, 1e-9, 1e-5, 1e-3])
def test_line_seen_end_on_measures_nothing(phase: str, off_rad: float) -> None:
    """Nor a line in single precision, whose rounding goes in all directions."""
    line = np.linspace(0.0, 1.0, 100)[:, None] * direction(AZIMUTH, POLAR)
    for chi in (line, (line + 3.0).astype(np.float32).astype(np.float64) - 3.0):
        bound = crb(chi, WAVELENGTH_M, AZIMUTH + off_rad, POLAR, phase="known" if phase == "known" else "unknown")
        assert bound.great_circle_rad == math.inf
        if off_rad == 0.0:
            assert (bound.azimuth_rad2, bound.polar_rad2, bound.covariance_rad2) == (math.inf, math.inf, 0.0)
    level = crb(_line(), WAVELENGTH_M, math.atan2(0.8, 0.6), math.pi / 2)
    assert (level.azimuth_rad2, level.polar_rad2) == (math.inf, math.inf)


def test_line_seen_across_determines_the_angle_it_lies_along() -> None:
    """Horizontal line, source on the horizon: the polar angle is blind, the azimuth is not."""
    bound = crb(_line(), WAVELENGTH_M, AZIMUTH, math.pi / 2)
    assert 0 < bound.azimuth_rad2 < 1e-3
    assert bound.polar_rad2 == math.inf


def test_flat_aperture_and_a_source_in_its_plane() -> None:
    chi = circle()[1]
    level = crb(chi, WAVELENGTH_M, AZIMUTH, math.pi / 2)
    assert level.polar_rad2 == level.great_circle_rad == math.inf
    assert level.azimuth_rad2 < 1e-4
    assert crb(chi, WAVELENGTH_M, AZIMUTH, POLAR).polar_rad2 < 1e-4


def test_no_motion_and_one_packet() -> None:
    for packets in (1, 5):
        bound = crb(np.ones((packets, 3)), WAVELENGTH_M, AZIMUTH, POLAR)
        assert bound.azimuth_rad2 == bound.polar_rad2 == math.inf


def test_poles_do_not_dominate_the_great_circle() -> None:
    """An aperture alike in all directions is as informative at a pole; the variance of the azimuth there is not."""
    rng = np.random.default_rng(9)
    chi = rng.normal(size=(20_000, 3))
    chi /= np.linalg.norm(chi, axis=1, keepdims=True)
    equator, pole = (crb(chi, WAVELENGTH_M, 0.3, polar) for polar in (math.pi / 2, 0.01))
    assert pole.great_circle_rad == pytest.approx(equator.great_circle_rad, rel=0.02)
    assert pole.azimuth_rad2 > 5000 * equator.azimuth_rad2
    assert crb(chi, WAVELENGTH_M, 0.3, 0.0).azimuth_rad2 == math.inf
    assert great_circle(direction(0.3, 0.0), direction(2.0, 0.0)) < 1e-12


@pytest.mark.parametrize("phase", _PHASES)
def test_closed_forms_are_means_over_the_path(phase: Phase) -> None:
    radius, directions = 0.35, list(zip(_AZIMUTHS.tolist(), _POLARS.tolist(), strict=True))
    helix_m, circle_m = radius * direction(_TAU, _TAU), radius * direction(_TAU, np.pi / 2)
    along, length = direction(0.4, 1.0), 2.0
    line_m = length * (np.arange(4096)[:, None] + 0.5) / 4096 * along
    for chi, closed in (
        (helix_m, closed_forms.helix(radius, WAVELENGTH_M, _AZIMUTHS, _POLARS, phase=phase)),
        (circle_m, closed_forms.circle(radius, WAVELENGTH_M, _AZIMUTHS, _POLARS)),
        (line_m, closed_forms.line(length, along, WAVELENGTH_M, azimuth_rad=_AZIMUTHS, polar_rad=_POLARS, phase=phase)),
    ):
        mean = np.array(
            [
                fim(chi, WAVELENGTH_M, p, t, phase_variance_rad2=1.0, phase=phase, round_trip=False)
                for p, t in directions
            ]
        ) / len(chi)
        size = float(np.abs(mean).max())
        np.testing.assert_allclose(closed.a, mean[:, 1, 1], rtol=1e-6, atol=1e-9 * size)
        np.testing.assert_allclose(closed.b, mean[:, 0, 0], rtol=1e-6, atol=1e-9 * size)
        np.testing.assert_allclose(closed.c, mean[:, 0, 1], rtol=1e-6, atol=1e-9 * size)
    one_way = closed_forms.helix(radius, WAVELENGTH_M, _AZIMUTHS, _POLARS, phase=phase)
    product = closed_forms.helix(radius, WAVELENGTH_M, _AZIMUTHS, _POLARS, phase=phase, round_trip=True)
    np.testing.assert_allclose(_determinant(product), 16 * _determinant(one_way))
    determinant = _determinant(closed_forms.line(length, along, WAVELENGTH_M, azimuth_rad=_AZIMUTHS, polar_rad=_POLARS))
    assert np.abs(determinant).max() < 1e-9 * size**2


def _determinant(of: closed_forms.MeanInformation) -> npt.NDArray[np.float64]:
    return np.asarray(of.a * of.b - of.c**2)
