"""The bound in the near field."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.unit.wsr.scene import WAVELENGTH_M, weave
from wsr.crb import crb
from wsr.geometry import direction
from wsr.uncertainty import bound

Array = NDArray[np.float64]


def test_near_field_bound_is_the_inverse_of_the_gauss_newton_matrix() -> None:
    """Against numeric derivatives of exact distances; the unknown phase is eliminated by a Schur complement."""
    chi = weave(50)[1] - weave(50)[1].mean(axis=0)
    at = np.array([0.8, 1.1, 3.0])

    def phases(p: Array) -> Array:
        distance = np.linalg.norm(p[2] * direction(p[0], p[1]) - chi, axis=1) - p[2]
        return np.asarray(2 * np.pi / WAVELENGTH_M * distance)

    h = 1e-6
    columns = [(phases(at + h * e) - phases(at - h * e)) / (2 * h) for e in np.eye(3)] + [np.ones(50)]
    full = np.array([[np.sum(a * b) for b in columns] for a in columns])
    full = full[:3, :3] - np.outer(full[:3, 3], full[3, :3]) / full[3, 3]
    near = bound(chi, WAVELENGTH_M, at[0], at[1], range_m=at[2], level=False)
    np.testing.assert_allclose(near, np.linalg.inv(full), rtol=1e-4)


def test_near_field_bound_ends_in_the_far_field() -> None:
    """Far off the curvature tells no range, and of the angles what plane waves tell."""
    chi = weave(80)[1] - weave(80)[1].mean(axis=0)
    plane = crb(chi, WAVELENGTH_M, 0.8, 1.1, round_trip=False)
    far = bound(chi, WAVELENGTH_M, 0.8, 1.1, range_m=1e4, level=False)
    assert far[2, 2] > 1e4**2
    assert far[0, 0] == pytest.approx(plane.azimuth_rad2, rel=1e-2)
    assert far[1, 1] == pytest.approx(plane.polar_rad2, rel=1e-2)
    flat = bound(chi, WAVELENGTH_M, 0.8, 1.1, range_m=None, level=False)
    assert flat[0, 0] == pytest.approx(plane.azimuth_rad2)
    assert flat[1, 1] == pytest.approx(plane.polar_rad2)
    assert flat[2, 2] == math.inf
