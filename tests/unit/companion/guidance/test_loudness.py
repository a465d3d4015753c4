"""Received power tells distances apart, whatever the cards make of it, and never surely."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.guidance.loudness import Loudness
from companion.sim.shadowing import Shadowing

TARGET_M = np.array([14.0, 0.0, 0.5])


def _flown(loudness: Loudness, exponent: float, until_m: float, shadow: Shadowing | None = None) -> None:
    for x in np.arange(0.0, until_m, 0.3):
        place = np.array([x, 0.2 * math.sin(5 * x), 1.5])
        apart_m = float(np.linalg.norm(TARGET_M - place))
        power_dbm = -40.0 - 10 * exponent * math.log10(apart_m)
        if shadow is not None:
            power_dbm += 20 * math.log10(float(shadow.gain(place[None], TARGET_M[None])[0]))
        loudness.add(place, power_dbm, 0.25)


@pytest.mark.parametrize("exponent", [1.3, 1.7, 2.0])
def test_the_right_distance_is_likelier_than_a_far_one(exponent: float) -> None:
    loudness = Loudness()
    _flown(loudness, exponent, 10.0)
    near, right, far = loudness.evidence(np.array([[11.0, 0.0, 0.5], TARGET_M, [34.0, 0.0, 0.5]]))
    assert right > far + 0.5
    assert right > near - 1.0


def test_shadowing_is_not_taken_for_distance() -> None:
    """Over many rooms the truth is seldom much less likely than another distance."""
    apart = []
    for seed in range(60):
        loudness = Loudness()
        _flown(loudness, 2.0, 11.0, Shadowing(seed, 3.0))
        ranges_m = np.linspace(11.5, 40.0, 58)
        told = loudness.evidence(np.stack([ranges_m, 0 * ranges_m, 0 * ranges_m + 0.5], axis=1))
        apart.append(float(told.max() - np.interp(TARGET_M[0], ranges_m, told)))
    assert np.quantile(apart, 0.9) < 2.7  # half of chi2 of one at 98 %


def test_a_level_says_nothing() -> None:
    """Of cards that send louder the same is believed."""
    soft, loud = Loudness(), Loudness()
    for x in range(5):
        soft.add(np.array([x, 0.0, 1.0]), -60.0 + x, 1.0)
        loud.add(np.array([x, 0.0, 1.0]), -20.0 + x, 1.0)
    places = np.random.default_rng(1).normal(0.0, 8.0, (50, 3))
    np.testing.assert_allclose(soft.evidence(places), loud.evidence(places), rtol=1e-9)


def test_one_power_or_none_says_nothing() -> None:
    loudness = Loudness()
    loudness.add(np.zeros(3), math.nan, 1.0)
    loudness.add(np.zeros(3), -50.0, 0.0)
    loudness.add(np.zeros(3), -50.0, 1.0)
    np.testing.assert_array_equal(loudness.evidence(np.eye(3)), np.zeros(3))


def test_a_shift_of_the_frame_changes_nothing() -> None:
    loudness, delta = Loudness(), np.array([3.0, -2.0, 0.5])
    _flown(loudness, 2.0, 8.0)
    places = TARGET_M + np.random.default_rng(2).normal(0.0, 3.0, (20, 3))
    before = loudness.evidence(places)
    loudness.shift(delta)
    np.testing.assert_allclose(loudness.evidence(places + delta), before, atol=1e-3)


def test_it_is_the_regression_with_both_constants_integrated() -> None:
    """Against the marginal normal density of all powers, term by term."""
    rng = np.random.default_rng(3)
    loudness = Loudness()
    heard_m, powers = rng.normal(0.0, 4.0, (7, 3)), rng.normal(-50.0, 5.0, 7)
    for place, power in zip(heard_m, powers, strict=True):
        loudness.add(place, float(power), 1.0)
    origins = rng.normal(0.0, 6.0, (4, 3))
    x = -10 * np.log10(np.maximum(np.linalg.norm(origins[:, None] - heard_m, axis=2), 0.7))
    expected = []
    for row in x:
        covariance = 2.5 * 16.0 * np.eye(7) + 15.0**2 + 0.5**2 * np.outer(row, row)
        miss = powers - powers[0] - 1.5 * row
        expected.append(-0.5 * (miss @ np.linalg.solve(covariance, miss) + np.linalg.slogdet(covariance)[1]))
    found = loudness.evidence(origins)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], atol=1e-3)  # by float32
