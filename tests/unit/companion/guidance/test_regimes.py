"""Whatever kind of room bearings come from, the belief comes to know it, and is as sure as it is right."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.regimes import (
    ECHOING,
    HARD,
    KIND,
    REGIMES,
    Regime,
    changed,
    drawn_elevation,
    of_bearing,
    of_power,
    prior_share,
)
from companion.guidance.tracker import TargetTracker
from companion.sensing.records import Bearing
from companion.study.belief import check
from companion.study.chi_square import middle_95

OWN_RAD = 0.02
HEADING_RAD = math.radians(7.0)
GROUND_M = 0.0
PARTS = 4
_MISSIONS = 8


def flight(regime: Regime, rng: np.random.Generator, target: np.ndarray, count: int) -> Iterator[Bearing]:
    """Apertures on the way to beside a target, with the errors of such a room; what is not the direct path is an image
    of the target in a wall, or noise."""
    image = target + np.array([rng.uniform(4.0, 12.0), rng.uniform(-6.0, 6.0), 0.0])
    heading, elevation = rng.normal(0.0, HEADING_RAD), rng.normal(0.0, regime.elevation_std_rad)
    away = target[:2] / np.linalg.norm(target[:2])
    beside = target[:2] + 1.3 * np.array([-away[1], away[0]])
    for number in range(count):
        share = min(1.0, 1.2 * number / count)
        place = np.array([*(share * beside + math.sin(2.5 * share) * np.array([away[1], -away[0]])), 1.5])
        range_m = math.dist(target, place)
        afar = min(1.0, max(0.0, (range_m - 2.5) / 3.5))
        reliability = min(1.0, rng.exponential(regime.reliability))
        near, far, more = regime.reported
        direct = rng.uniform() < min(0.99, near + (far - near) * afar + more * reliability)
        seen = target if direct else image if rng.uniform() < 0.8 else place + rng.normal(size=3)
        x, y, z = seen - place
        unseen = regime.unseen[0] + (regime.unseen[1] - regime.unseen[0]) * afar
        bent = 1.0 / range_m + 0.12 * rng.standard_normal()
        shows = direct and rng.uniform() > unseen and bent > 0.05
        yield Bearing(
            t_mono_ns=round(number * 2e9),
            p_local_enu_m=tuple(place.tolist()),
            azimuth_rad=math.atan2(y, x) + heading + math.hypot(OWN_RAD, regime.across_std_rad) * rng.standard_normal(),
            polar_rad=math.acos(z / math.hypot(x, y, z))
            + elevation
            + math.hypot(OWN_RAD, regime.down_std_rad) * rng.standard_normal(),
            azimuth_std_rad=OWN_RAD,
            polar_std_rad=OWN_RAD,
            target_p_enu_m=(0.0, 0.0, 0.0),
            target_boot=1,
            reliability=reliability,
            range_m=1.0 / bent if shows else None,
            range_std_m=0.02 / bent**2 if shows else math.inf,
            power_dbm=-40.0 - 20.0 * math.log10(range_m) + 3.0 * rng.standard_normal(),
        )


@functools.cache
def flown(regime: Regime, seed: int, count: int) -> tuple[list[float], np.ndarray]:
    """NEES after each aperture, and the probabilities of the kinds of room in the end."""
    rng = np.random.default_rng(seed)
    range_m, azimuth = rng.uniform(6.0, 20.0), rng.uniform(-math.pi, math.pi)
    target = np.array([range_m * math.cos(azimuth), range_m * math.sin(azimuth), rng.uniform(0.2, 1.0)])
    tracker, errors = TargetTracker(), []
    for number, bearing in enumerate(flight(regime, rng, target, count)):
        for _ in range(PARTS if number else 1):  # as apertures that overlap
            found = tracker.add(replace(bearing, fresh=1.0 / PARTS if number else 1.0), GROUND_M)
        errors.append(check(found, bearing.target_p_enu_m, tuple(target.tolist()), bearing.p_local_enu_m).nees)
    return errors, tracker.rooms()


@pytest.mark.parametrize(
    "regime", [KIND, pytest.param(ECHOING, marks=pytest.mark.long), HARD], ids=["kind", "echoing", "hard"]
)
def test_a_belief_is_as_sure_as_it_is_right_in_every_kind_of_room(regime: Regime) -> None:
    """The mean over missions and reports lies in the band that a mean over missions has at each report, and most of the
    reports do not exceed it. It may be below: these targets are nearer than the prior's."""
    nees = np.mean([flown(regime, seed, 14)[0] for seed in range(_MISSIONS)], axis=0)
    low, high = middle_95(3 * _MISSIONS) / _MISSIONS
    assert np.mean(nees < high) >= 2 / 3
    assert 0.5 * low < np.mean(nees) < high


@pytest.mark.parametrize(("regime", "number"), [(KIND, 0), (HARD, 2)])
def test_the_kind_of_room_is_told_by_its_bearings(regime: Regime, number: int) -> None:
    likely = [flown(regime, seed, 14)[1] for seed in range(_MISSIONS)]
    assert np.argmax(np.mean(likely, axis=0)) == number
    assert np.mean(likely, axis=0)[number] > 0.6


def test_a_power_says_nothing_of_the_kind_and_a_bearing_of_the_place_counts_less_in_a_hard_room() -> None:
    rng = np.random.default_rng(3)
    share, weight = prior_share(rng.normal(0.0, 0.1, 50)), np.full(50, 1.0 / 50)
    room = share @ weight
    np.testing.assert_allclose((share * of_power(share, weight, rng.normal(size=50))) @ weight, room)
    found = rng.uniform(0.1, 5.0, (3, 50))
    whole, half = of_bearing(share, weight, found, 1.0), of_bearing(share, weight, found, 0.5)
    np.testing.assert_allclose((share * whole) @ weight, (share * found) @ weight)
    for regime, factor, part in zip(REGIMES, whole, half, strict=True):
        assert np.log(factor).std() == pytest.approx(regime.counted * np.log(found[REGIMES.index(regime)]).std())
        assert np.log(part).std() == pytest.approx(np.log(factor).std() / 2)


def test_elevations_that_are_far_off_are_those_of_worse_rooms() -> None:
    share = prior_share(np.array([0.0, math.radians(15.0)]))
    np.testing.assert_allclose(share.sum(axis=0), 1.0)
    assert share[0, 0] > share[2, 0] and share[2, 1] > share[1, 1] > share[0, 1]
    drawn = drawn_elevation(np.random.default_rng(1), 4000)
    assert drawn.std() == pytest.approx(math.sqrt(sum(r.prior * r.elevation_std_rad**2 for r in REGIMES)), rel=0.1)


def test_rooms_may_change_on_the_way() -> None:
    share = np.array([[1.0], [0.0], [0.0]])
    for _ in range(200):
        share = changed(share, 1.0)
    np.testing.assert_allclose(share[:, 0], [KIND.prior, ECHOING.prior, HARD.prior], atol=0.02)
