"""The bound of many directions, in closed form and of near sources, each against the scalar bound or derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, weave
from wsr.crb import Phase, crb, fim
from wsr.crb.sphere import crb_over, scatter_factor
from wsr.geometry import direction

_GRID = np.meshgrid(np.arange(-170, 180, 31), np.arange(3, 180, 28))
AZIMUTH, POLAR = (np.radians(a.ravel()) for a in _GRID)
PHASES: tuple[Phase, Phase] = ("known", "unknown")


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("round_trip", [True, False])
def test_many_directions_are_the_scalar_bound_each(phase: Phase, round_trip: bool) -> None:
    chi, variance = weave(70)[1] - weave(70)[1].mean(axis=0), np.linspace(0.1, 0.5, 70)
    factor = scatter_factor(chi, WAVELENGTH_M, variance, phase, round_trip=round_trip)
    field = crb_over(factor, AZIMUTH, POLAR)
    for i, (azimuth, polar) in enumerate(zip(AZIMUTH.tolist(), POLAR.tolist(), strict=True)):
        one = crb(chi, WAVELENGTH_M, azimuth, polar, phase_variance_rad2=variance, phase=phase, round_trip=round_trip)
        single = fim(
            chi, WAVELENGTH_M, azimuth, polar, phase_variance_rad2=variance, phase=phase, round_trip=round_trip
        )
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
