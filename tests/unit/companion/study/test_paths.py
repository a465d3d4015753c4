"""Paths of a wanted length, sampled at equal steps of it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from companion.study.paths import circle, climbing_helix, line, resample, scaled_to, spherical_helix, wander

_MAKERS: dict[str, Callable[[float, int], npt.NDArray[np.float64]]] = {
    "spherical helix": spherical_helix,
    "two turns of it": lambda length, count: spherical_helix(length, count, 2.0),
    "climbing helix": climbing_helix,
    "circle": circle,
    "line": line,
    "wander": lambda length, count: wander(np.random.default_rng(1), length, count, planar=False),
}


@pytest.mark.parametrize("name", _MAKERS)
def test_each_is_as_long_as_was_asked_in_equal_steps(name: str) -> None:
    points = _MAKERS[name](2.5, 400)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert points.shape == (400, 3)
    assert steps.sum() == pytest.approx(2.5, rel=2e-3)
    assert np.ptp(steps) < 0.02 * steps.mean()


def test_their_shapes() -> None:
    around = circle(2 * math.pi * 0.4, 300)
    assert np.linalg.norm(around[:, :2], axis=1) == pytest.approx(0.4, abs=1e-3)
    assert not around[:, 2].any()
    helix = climbing_helix(3.0, 300, turns=2.0, pitch=0.5)
    assert helix[-1, 2] / np.linalg.norm(np.diff(helix[:, :2], axis=0), axis=1).sum() == pytest.approx(0.5, rel=0.01)
    assert line(2.0, 5, azimuth_rad=math.pi / 2)[-1] == pytest.approx([0.0, 2.0, 0.0])
    assert not wander(np.random.default_rng(1), 2.0, 50, planar=True)[:, 2].any()
    spatial = np.linalg.svd(spherical_helix(2.0, 200) - spherical_helix(2.0, 200).mean(axis=0), compute_uv=False)
    assert spatial[2] > 0.2 * spatial[0], "it fills all three axes"


def test_a_seed_gives_its_path_again() -> None:
    first, second, other = (wander(np.random.default_rng(s), 2.0, 50, False) for s in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_both_ends_stay_and_a_shape_keeps_its_form() -> None:
    corner = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 1.0, 0.0]])
    even = resample(corner, 5)
    assert even.tolist() == [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [3, 1, 0]]
    np.testing.assert_allclose(scaled_to(corner, 8.0), 2 * corner)
