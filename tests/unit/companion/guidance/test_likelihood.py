"""How likely an aperture's paths are for targets at given places: a density, highest where it points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.likelihood import CURVATURE_SCALE, CURVATURE_STD_PER_M, elsewhere, is_afar, likelihoods
from companion.guidance.regimes import HARD, REGIMES
from companion.sensing.records import Bearing
from wsr.directions import Peak
from wsr.geometry import direction

BEARING = Bearing(
    t_mono_ns=0, p_local_enu_m=(0.0, 0.0, 1.5), azimuth_rad=0.4, polar_rad=1.5, azimuth_std_rad=0.02,
    polar_std_rad=0.03, target_p_enu_m=(0.0, 0.0, 0.0), target_boot=1, reliability=0.8,
)  # fmt: skip
NO_DIRECTIONS = np.zeros((0, 3))
ANYWHERE = 1.0 / (4.0 * math.pi)
_OWN_PER_M, _TRUE_M, _SHOWS = 0.04, 30.0, 2.0


def _at(bearing: Bearing, azimuth: float, polar: float = 1.5, range_m: float = 8.0) -> np.ndarray:
    (found,) = likelihoods(
        bearing, np.array([azimuth]), np.array([polar]), np.array([range_m]), elsewhere=ANYWHERE, drift=0.0
    ).T  # fmt: skip
    return np.asarray(found)


def test_it_is_highest_in_the_direction_that_is_reported() -> None:
    there, beside, behind = _at(BEARING, 0.4), _at(BEARING, 0.5), _at(BEARING, 0.4 + math.pi)
    assert np.all(there > beside)
    assert np.all(beside > behind)
    assert np.all(behind > 0.0), "it may have been another source's"
    assert behind[0] / there[0] < behind[2] / there[2], "which a hard room makes more likely"


def test_an_azimuth_goes_around() -> None:
    near_the_seam = replace(BEARING, azimuth_rad=math.pi - 0.01)
    np.testing.assert_allclose(_at(near_the_seam, -math.pi + 0.01), _at(near_the_seam, math.pi - 0.03))


def test_without_a_polar_angle_heights_are_alike() -> None:
    half_plane = replace(BEARING, polar_std_rad=math.inf)
    np.testing.assert_allclose(_at(half_plane, 0.4, 1.3), _at(half_plane, 0.4, 1.3 + 1e-9))
    assert _at(half_plane, 0.4, 1.0)[0] > 0.5 * _at(half_plane, 0.4, 1.5)[0]
    assert _at(BEARING, 0.4, 1.0)[0] < 0.01 * _at(BEARING, 0.4, 1.5)[0]


def test_what_is_seen_again_is_a_density_without_a_polar_angle_too() -> None:
    before = np.array([direction(0.3, 1.4), direction(2.0, 1.7)])
    half_plane = replace(BEARING, polar_std_rad=math.inf)
    around = np.linspace(-math.pi, math.pi, 1000, endpoint=False)
    mean = np.mean([elsewhere(replace(half_plane, azimuth_rad=float(a)), before) for a in around])
    assert mean == pytest.approx(ANYWHERE, rel=1e-2)
    assert elsewhere(replace(half_plane, azimuth_rad=0.3), before) > 2 * ANYWHERE


@pytest.mark.parametrize("polar", [1.57, 0.6, 0.1, 0.001, math.pi - 0.05])
def test_over_all_azimuths_a_bearing_without_a_polar_angle_is_as_likely_for_any_target(polar: float) -> None:
    """So none that is right below is believed because it would explain every azimuth."""
    around = np.linspace(-math.pi, math.pi, 2000, endpoint=False)
    half_plane = replace(BEARING, polar_std_rad=math.inf)
    total = np.mean([_at(replace(half_plane, azimuth_rad=float(a)), 0.3, polar) for a in around], axis=0)
    anywhere = np.mean([_at(replace(half_plane, azimuth_rad=float(a)), 0.3) for a in around], axis=0)
    np.testing.assert_allclose(total, anywhere, rtol=2e-3)


def test_a_range_that_shows_counts_in_every_kind_of_room() -> None:
    ranged = replace(BEARING, range_m=4.0, range_std_m=0.3)
    for better, worse in ((4.0, 2.0), (4.0, 12.0)):
        gain = _at(ranged, 0.4, range_m=better) / _at(ranged, 0.4, range_m=worse)
        assert np.all(gain > 1.0)


def test_another_path_may_be_the_direct_one() -> None:
    alone, seen = (
        BEARING,
        replace(BEARING, others=(Peak(azimuth_rad=2.0, polar_rad=1.5, power=0.4, relative_power=0.5),)),
    )
    assert np.all(_at(seen, 2.0) > _at(alone, 2.0))
    assert np.all(_at(seen, -2.0) < _at(alone, -2.0))
    hard = REGIMES.index(HARD)
    assert _at(seen, 2.0)[hard] / _at(seen, 0.4)[hard] > _at(seen, 2.0)[0] / _at(seen, 0.4)[0]


def test_images_are_louder_from_afar() -> None:
    assert is_afar(np.array([1.0, 2.5, 4.25, 6.0, 50.0])).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_what_is_no_target_is_there_again_where_it_was_or_anywhere() -> None:
    """A density: over the sphere it comes to one."""
    assert elsewhere(BEARING, NO_DIRECTIONS) == pytest.approx(ANYWHERE)
    before = direction(np.array([0.4, 0.41]), np.array([1.5, 1.5]))
    assert elsewhere(BEARING, before) > 5 * ANYWHERE
    assert elsewhere(replace(BEARING, azimuth_rad=-2.0), before) < ANYWHERE
    rng = np.random.default_rng(0)
    u = rng.normal(size=(4000, 3))
    azimuth, polar = np.arctan2(u[:, 1], u[:, 0]), np.arccos(u[:, 2] / np.linalg.norm(u, axis=1))
    of_all = [
        elsewhere(replace(BEARING, azimuth_rad=a, polar_rad=p), before)
        for a, p in zip(azimuth.tolist(), polar.tolist(), strict=True)
    ]
    assert 4 * math.pi * np.mean(of_all) == pytest.approx(1.0, abs=0.2)


def _ranged(per_m: float) -> Bearing:
    level = replace(BEARING, azimuth_rad=0.0, polar_rad=math.pi / 2, azimuth_std_rad=0.01, polar_std_rad=0.01)
    return replace(level, reliability=0.5, range_m=1.0 / per_m, range_std_m=_OWN_PER_M / per_m**2)


def test_ranges_of_a_far_source_show_where_they_seem_near_and_do_not_draw_it_nearer() -> None:
    """A range is told where its curvature is twice its deviation: the mean of those of 30 m is then some 6 m."""
    rng = np.random.default_rng(1)
    std = math.hypot(CURVATURE_STD_PER_M, CURVATURE_SCALE * _OWN_PER_M)
    drawn = 1.0 / _TRUE_M + std * rng.standard_normal(1500)
    shown = drawn[drawn > _SHOWS * _OWN_PER_M]
    assert len(shown) > 400 and 1.0 / shown.mean() < 8.0
    ranges_m = np.array([6.5, 10.0, _TRUE_M])
    straight = np.zeros(3), np.full(3, math.pi / 2)
    told = np.mean(
        [np.log(likelihoods(_ranged(per_m), *straight, ranges_m, elsewhere=0.1, drift=0.0)[0]) for per_m in shown],
        axis=0,
    )
    assert told[2] > told[1] > told[0], told
