"""What an estimate says about itself: its bound, what can be observed, and which peaks are another path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, Array, circle, far, round_trip, weave
from wsr.aperture import Aperture, make_aperture
from wsr.crb import crb
from wsr.directions import Peak
from wsr.estimators.description import describe, is_horizontal, without_image
from wsr.estimators.trust import Evidence, model_error_rad, reliability
from wsr.geometry import direction

AT = (2.1, 1.2)
BEST = Peak(azimuth_rad=AT[0], polar_rad=AT[1], power=0.81, relative_power=1.0)
IMAGE = replace(BEST, polar_rad=math.pi - AT[1])
RIVAL = Peak(azimuth_rad=-1.0, polar_rad=1.4, power=0.27, relative_power=1 / 3)


def _aperture(t: Array, p: Array, noise_rad: float = 0.2) -> Aperture:
    return make_aperture(t, p, round_trip(p, far(p, direction(*AT)), noise_rad, seed=3), WAVELENGTH_M)


def test_the_bound_is_that_of_the_noise_that_is_left() -> None:
    aperture = _aperture(*weave(400))
    estimate = describe(aperture, aperture.channel, BEST, None, others=(RIVAL,))
    limit = crb(aperture.chi_m, WAVELENGTH_M, *AT, phase_variance_rad2=0.2**2)
    assert estimate.crb_rad == pytest.approx(limit.great_circle_rad, rel=0.1)
    assert estimate.azimuth_std_rad == pytest.approx(math.sqrt(limit.azimuth_rad2), rel=0.6)
    assert estimate.covariance[2][2] == math.inf
    assert (estimate.azimuth_observable, estimate.polar_observable) == (True, True)


def test_without_evidence_reliability_is_coherence_times_lead() -> None:
    aperture = _aperture(*weave(400))
    estimate = describe(aperture, aperture.channel, BEST, None, others=(RIVAL,))
    assert estimate.coherence == pytest.approx(0.9)
    assert estimate.reliability == pytest.approx(0.9 * (1 - 1 / 3))
    assert estimate.paths == (BEST, RIVAL)


def test_with_evidence_its_error_and_reliability_are_taken() -> None:
    aperture, evidence = _aperture(*weave(400)), Evidence(0.7, 0.2, 10.0)
    bare = describe(aperture, aperture.channel, BEST, None, others=())
    told = describe(aperture, aperture.channel, BEST, None, others=(), evidence=evidence)
    assert told.reliability == pytest.approx(reliability(evidence))
    assert told.coherence == 0.7
    assert told.covariance[1][1] - bare.covariance[1][1] == pytest.approx(model_error_rad(evidence) ** 2)


def test_over_a_level_path_the_polar_angle_is_not_observable() -> None:
    aperture = _aperture(*circle(400))
    estimate = describe(aperture, aperture.channel, BEST, IMAGE, others=())
    assert (estimate.azimuth_observable, estimate.polar_observable) == (True, False)
    assert estimate.alternatives == (IMAGE,)


def test_over_an_upright_plane_the_image_leaves_the_azimuth_open() -> None:
    t, level = circle(400)
    aperture = _aperture(t, level[:, [0, 2, 1]])
    image = replace(BEST, azimuth_rad=-AT[0])
    estimate = describe(aperture, aperture.channel, BEST, image, others=(), evidence=Evidence(0.9, 0.0, 10.0))
    assert not estimate.azimuth_observable
    assert estimate.polar_observable
    assert estimate.reliability == pytest.approx(0.5 * reliability(Evidence(0.9, 0.0, 10.0)))


def test_peaks_beside_the_best_and_beside_its_image_are_no_other_paths() -> None:
    near, beside_image = replace(BEST, azimuth_rad=AT[0] + 0.05), replace(IMAGE, azimuth_rad=AT[0] - 0.05)
    assert without_image((near, beside_image, RIVAL), BEST, IMAGE) == (RIVAL,)
    assert without_image((near, beside_image, RIVAL), BEST, None) == (beside_image, RIVAL)
    assert without_image((), BEST, None) == ()


@pytest.mark.parametrize(("tilt_deg", "level"), [(0.0, True), (29.0, True), (31.0, False), (90.0, False)])
def test_a_plane_is_level_up_to_thirty_degrees(tilt_deg: float, level: bool) -> None:
    tilt = math.radians(tilt_deg)
    for sign in (1.0, -1.0):
        assert is_horizontal(sign * np.array([math.sin(tilt), 0.0, math.cos(tilt)])) == level
