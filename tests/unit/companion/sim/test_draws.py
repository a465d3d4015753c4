"""Exchange n of a seed has the same draws in whatever batches they are made."""

from __future__ import annotations

import numpy as np
import pytest

from companion.sim.draws import exchange_draws

_NAMES = ("normals", "uniforms", "delivery", "noise")


@pytest.mark.parametrize(("first", "count"), [(0, 1), (0, 300), (100, 60), (127, 2), (128, 128), (255, 3)])
def test_a_batch_is_a_part_of_the_whole(first: int, count: int) -> None:
    whole, part = exchange_draws(5, 0, 400), exchange_draws(5, first, count)
    for name in _NAMES:
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[first : first + count])


def test_another_seed_draws_others() -> None:
    a, b = exchange_draws(5, 0, 10), exchange_draws(6, 0, 10)
    assert not any(np.array_equal(getattr(a, name), getattr(b, name)) for name in _NAMES)


def test_they_are_of_the_laws_that_are_named() -> None:
    draws = exchange_draws(1, 0, 4000)
    assert draws.normals.shape == (4000, 5)
    assert draws.normals.std() == pytest.approx(1.0, abs=0.02)
    assert draws.uniforms.shape == (4000, 7)
    assert 0.0 <= draws.uniforms.min() < 0.01
    assert 0.99 < draws.uniforms.max() < 1.0
    assert draws.delivery.mean() == pytest.approx(1.0, abs=0.03)
    assert draws.noise.shape == (4000, 2, 30, 3)
    assert np.mean(np.abs(draws.noise) ** 2) == pytest.approx(1.0, abs=0.01)
