"""Straight paths: what each estimator says of the cone, and of what it cannot know."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, Array, circle, exchange
from wsr.aperture import Aperture, make_aperture
from wsr.estimators import ESTIMATORS
from wsr.geometry import direction, great_circle

U = direction(0.9, 1.2)
_ALONG = {"level": [1.0, 0.0, 0.0], "slanted": [0.7, 0.3, 0.5], "upright": [0.0, 0.0, 1.0]}


def _aperture(p: Array, u: Array = U, distance_m: float = 200.0) -> Aperture:
    forward, reverse = exchange(p, (p.mean(axis=0) + distance_m * u)[None, :])
    product = forward[:, 15].astype(np.complex128) * reverse[:, 15]
    return make_aperture(np.linspace(0, 4, len(p)), p, product, WAVELENGTH_M, forward=forward, reverse=reverse)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("along", _ALONG)
def test_cone_and_what_lies_on_it(name: str, along: str) -> None:
    axis = np.array(_ALONG[along]) / np.linalg.norm(_ALONG[along])
    estimate, _ = ESTIMATORS[name]().estimate(_aperture(np.outer(np.linspace(0, 1, 500), axis)))
    assert estimate.cone is not None
    assert float(np.array(estimate.cone.axis) @ axis) == pytest.approx(1.0)
    truth = float(great_circle(U, axis))
    assert estimate.cone.angle_rad == pytest.approx(truth, abs=math.radians(1))
    assert abs(estimate.cone.angle_rad - truth) < 3 * estimate.cone.angle_std_rad < math.radians(15)
    found = direction(estimate.azimuth_rad, estimate.polar_rad)
    others = [direction(other.azimuth_rad, other.polar_rad) for other in estimate.alternatives]
    assert len(others) >= 2
    for u in (found, *others):
        assert float(great_circle(u, axis)) == pytest.approx(estimate.cone.angle_rad, abs=1e-6)
    assert all(float(great_circle(found, u)) > math.radians(3) for u in others)
    assert not estimate.azimuth_observable
    assert estimate.azimuth_std_rad == math.inf
    assert estimate.polar_observable == (along == "upright")
    if along == "upright":
        assert abs(math.remainder(estimate.alternatives[0].azimuth_rad - estimate.azimuth_rad, math.tau)) > 3.1
        assert abs(estimate.polar_rad - 1.2) < 3 * estimate.polar_std_rad < math.radians(20)
    assert estimate.range_m is None
    assert estimate.reliability == 0.0  # a bearing it is not


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_twin_comes_first(name: str) -> None:
    estimate, _ = ESTIMATORS[name]().estimate(_aperture(np.outer(np.linspace(0, 1, 500), [1.0, 0.0, 0.0])))
    twin = estimate.alternatives[0]
    assert twin.azimuth_rad == pytest.approx(-estimate.azimuth_rad)
    assert twin.polar_rad == pytest.approx(estimate.polar_rad)


def test_straight_ahead_the_azimuth_is_known() -> None:
    """Where the cone is as narrow as a needle all of it points the same way."""
    axis = direction(0.5, math.pi / 2)
    estimate, _ = ESTIMATORS["robust"]().estimate(_aperture(np.outer(np.linspace(0, 1, 500), axis), axis))
    assert estimate.cone is not None
    assert estimate.cone.angle_rad < math.radians(8)
    assert abs(math.remainder(estimate.azimuth_rad - 0.5, math.tau)) < 3 * estimate.azimuth_std_rad


@pytest.mark.parametrize("name", ["bartlett", "music"])
def test_two_azimuths_halve_the_reliability(name: str) -> None:
    _, p = circle(500, 0.25)
    level, _ = ESTIMATORS[name]().estimate(_aperture(p, direction(0.9, 0.6)))
    assert level.cone is None
    assert level.azimuth_observable
    assert level.reliability > 0.95  # the image, below, is no rival
    upright, _ = ESTIMATORS[name]().estimate(_aperture(p[:, [0, 2, 1]]))
    assert not upright.azimuth_observable
    assert 0.3 < upright.reliability <= 0.5
    assert upright.alternatives[0].azimuth_rad == pytest.approx(-upright.azimuth_rad, abs=0.01)
