"""Which places of a belief are one source."""

from __future__ import annotations

import numpy as np
import pytest

from companion.guidance.modes import densest, systematic


def _cloud(direction: tuple[float, float, float], range_m: float, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    unit = np.array(direction) / np.linalg.norm(direction)
    spread = unit + 0.05 * rng.normal(size=(count, 3))
    units = spread / np.linalg.norm(spread, axis=1, keepdims=True)
    return np.asarray(units * range_m * np.exp(0.1 * rng.normal(size=(count, 1))))


EAST, NORTH = _cloud((1, 0, 0), 4.0, 300, 1), _cloud((0, 1, 0), 4.0, 200, 2)
FAR_EAST = _cloud((1, 0, 0), 20.0, 200, 3)


def test_the_densest_source_is_found_and_others_left_out() -> None:
    for others in (NORTH, FAR_EAST):
        found = densest(np.vstack([EAST, others]), np.full(500, 0.002))
        assert set(found) <= set(range(300)), "neither another direction nor another range is the same source"
        assert len(found) > 280


def test_weight_decides_and_not_the_number_of_places() -> None:
    weight = np.append(np.full(300, 0.001), np.full(200, 0.01))
    found = densest(np.vstack([EAST, NORTH]), weight)
    assert set(found) <= set(range(300, 500))
    assert len(densest(np.vstack([EAST, NORTH]), np.append(np.ones(300), np.zeros(200)))) > 280


def test_places_without_weight_belong_to_no_source() -> None:
    weight = np.ones(300)
    weight[::2] = 0.0
    assert np.all(densest(EAST, weight) % 2 == 1)


@pytest.mark.parametrize("count", [1, 10, 1000])
def test_a_systematic_sample_has_each_place_as_often_as_it_is_likely(count: int) -> None:
    probability = np.array([0.5, 0.0, 0.3, 0.2])
    picks = np.bincount(systematic(probability, count), minlength=4)
    assert picks.sum() == count
    assert picks[1] == 0
    assert np.abs(picks - count * probability).max() < 1.0
