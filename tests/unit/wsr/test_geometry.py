"""Directions and rotations: known angles and turns."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsr import geometry


@pytest.mark.parametrize(
    ("vector", "azimuth_deg", "polar_deg"),
    [
        ((1, 0, 0), 0, 90),
        ((0, 2, 0), 90, 90),
        ((-1, 0, 0), 180, 90),
        ((0, -1, 0), -90, 90),
        ((0, 0, 3), 0, 0),
        ((0, 0, -1), 0, 180),
        ((1, 1, math.sqrt(2)), 45, 45),
        ((-1, -1, -math.sqrt(2)), -135, 135),
    ],
)
def test_angles_of_known_vectors(vector: tuple[float, float, float], azimuth_deg: float, polar_deg: float) -> None:
    azimuth, polar = geometry.angles(vector)
    assert math.degrees(azimuth) == pytest.approx(azimuth_deg)
    assert math.degrees(polar) == pytest.approx(polar_deg)
    unit = np.array(vector, float) / np.linalg.norm(vector)
    np.testing.assert_allclose(geometry.direction(azimuth, polar), unit, atol=1e-12)


def test_direction_broadcasts() -> None:
    assert geometry.direction(np.zeros((1, 4)), np.ones((3, 1))).shape == (3, 4, 3)


def test_wrap_angle_is_half_open() -> None:
    np.testing.assert_allclose(
        geometry.wrap_angle([math.pi, -math.pi, 3.5 * math.pi, 0.1]), [-math.pi, -math.pi, -0.5 * math.pi, 0.1]
    )


def test_great_circle_resolves_a_microdegree_and_the_antipode() -> None:
    u = geometry.direction(1.0, 1.0)
    tiny = math.radians(1e-6)
    assert geometry.great_circle(u, geometry.direction(1.0, 1.0 + tiny)) == pytest.approx(tiny, rel=1e-6)
    assert geometry.great_circle(u, -u) == pytest.approx(math.pi)


def test_quaternion_turns_as_the_matrix_does() -> None:
    v = np.array([1.0, 2.0, 3.0])
    q = geometry.quaternion_from_yaw(0.7)
    np.testing.assert_allclose(geometry.rotate(q, v), geometry.rotation_z(0.7) @ v)
    np.testing.assert_allclose(
        geometry.rotate(geometry.quaternion_from_yaw(math.pi / 2), [1, 0, 0]), [0, 1, 0], atol=1e-15
    )


def test_product_applies_the_right_factor_first() -> None:
    roll = np.array([math.cos(0.4), math.sin(0.4), 0.0, 0.0])
    yaw = geometry.quaternion_from_yaw(1.1)
    v = np.array([0.3, -0.2, 0.9])
    np.testing.assert_allclose(
        geometry.rotate(geometry.quaternion_multiply(yaw, roll), v), geometry.rotate(yaw, geometry.rotate(roll, v))
    )


def test_yaw_of_a_pitched_attitude() -> None:
    pitch = np.array([math.cos(0.2), 0.0, math.sin(0.2), 0.0])
    q = geometry.quaternion_multiply(geometry.quaternion_from_yaw(-2.0), pitch)
    assert geometry.yaw_of(q) == pytest.approx(-2.0)
