"""Echoes among the paths of the robust estimate, made from image sources."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, Array, circle, exchange, weave
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture, make_aperture
from wsr.directions import Peak
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust
from wsr.geometry import direction, great_circle

SOURCE, WALL = direction(0.5, 1.3), direction(2.0, 1.8)


def _aperture(p: Array, echo: tuple[Array, float] | None, u: Array = SOURCE, noise: float = 0.05) -> Aperture:
    source = (p.mean(axis=0) + 6.0 * u)[None, :]
    forward, reverse = exchange(p, source, echo=echo, noise=noise)
    product = (forward * reverse).mean(axis=1)
    return make_aperture(np.linspace(0, 3, len(p)), p, product, WAVELENGTH_M, forward=forward, reverse=reverse)


def _estimate(amplitude: float, longer_m: float, options: RobustOptions | None = None) -> AoaEstimate:
    _, p = weave(500)
    echo = (p.mean(axis=0) + (6.0 + longer_m) * WALL, amplitude) if amplitude else None
    return Robust(options or RobustOptions()).estimate(_aperture(p, echo))[0]


def _off_deg(path: Peak, u: Array) -> float:
    return math.degrees(float(great_circle(direction(path.azimuth_rad, path.polar_rad), u)))


@pytest.mark.parametrize(("amplitude", "longer_m"), [(0.3, 6.0), (0.5, 3.0), (0.5, 1.0), (0.8, 6.0), (0.95, 15.0)])
def test_an_echo_is_a_path(amplitude: float, longer_m: float) -> None:
    estimate = _estimate(amplitude, longer_m)
    own, echo = estimate.paths[:2]
    assert len(estimate.paths) == 2  # and no side lobe is one
    assert (own.azimuth_rad, own.polar_rad) == (estimate.azimuth_rad, estimate.polar_rad)
    assert own.relative_power == 1.0
    assert _off_deg(own, SOURCE) < 1.5
    assert _off_deg(echo, WALL) < 1.0
    assert echo.relative_power == pytest.approx(amplitude**2, rel=0.3)
    assert 0.5 * echo.power < echo.prominence < echo.power
    assert math.radians(1) < echo.width_rad < math.radians(15)


def test_one_path_has_no_side_lobes_for_paths() -> None:
    assert len(_estimate(0.0, 0.0).paths) == 1


def test_an_echo_does_not_need_the_weight_for_the_delay() -> None:
    """What the reliability takes for a rival is another matter, and stays with the look."""
    plain = _estimate(0.8, 6.0, RobustOptions(delay_ns=None))
    assert _off_deg(plain.paths[1], WALL) < 1.0
    assert plain.reliability < _estimate(0.8, 6.0).reliability


def test_a_stronger_late_path_is_listed_as_the_stronger() -> None:
    estimate = _estimate(1.15, 9.0)
    assert _off_deg(estimate.paths[0], SOURCE) < 3.0
    assert _off_deg(estimate.paths[1], WALL) < 1.0
    assert estimate.paths[1].relative_power == 1.0
    assert estimate.paths[0].relative_power == pytest.approx(1 / 1.15**2, rel=0.2)


def test_power_of_a_path_is_not_that_behind_a_limiter() -> None:
    """Packets brought to equal power show a weak path with a quarter of its power."""
    weak = _estimate(0.3, 6.0).paths[1].relative_power
    assert weak == pytest.approx(0.09, rel=0.3)
    assert _estimate(0.3, 6.0, RobustOptions(unit_power=False)).paths[1].relative_power == pytest.approx(weak, rel=0.1)


def test_echo_over_a_level_path() -> None:
    _, p = circle(600)
    wall = direction(2.0, math.pi / 2)
    estimate, _ = Robust().estimate(_aperture(p, (p.mean(axis=0) + 12.0 * wall, 0.7), direction(0.5, math.pi / 2)))
    assert estimate.azimuth_rad == pytest.approx(0.5, abs=0.02)
    assert len(estimate.paths) == 2
    assert estimate.paths[1].azimuth_rad == pytest.approx(2.0, abs=math.radians(1))
    assert estimate.paths[1].relative_power == pytest.approx(0.49, rel=0.25)


def test_without_subcarriers_it_still_works() -> None:
    _, p = weave(500)
    aperture = _aperture(p, None)
    estimate, _ = Robust().estimate(replace(aperture, forward=None, reverse=None))
    assert _off_deg(estimate.paths[0], SOURCE) < 1.0
