"""Invariants of directions, quaternions and axes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wsr import frames, geometry

angle = st.floats(-20, 20)
length = st.floats(-100, 100)
vectors = st.tuples(length, length, length).map(np.array).filter(lambda v: np.linalg.norm(v) > 1e-3)
unit_quaternions = (st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1)).map(
    lambda q: q / np.linalg.norm(q)
)


@given(vectors)
def test_angles_and_direction_are_inverse(v: geometry.Array) -> None:
    np.testing.assert_allclose(geometry.direction(*geometry.angles(v)), v / np.linalg.norm(v), atol=1e-12)


@given(angle)
def test_wrapped_angle_is_the_same_angle(value: float) -> None:
    wrapped = geometry.wrap_angle(value)
    assert -np.pi <= wrapped < np.pi
    assert abs(np.exp(1j * wrapped) - np.exp(1j * value)) < 1e-12


@given(unit_quaternions, unit_quaternions, vectors)
def test_rotation_keeps_length_and_products_compose(a: geometry.Array, b: geometry.Array, v: geometry.Array) -> None:
    turned = geometry.rotate(geometry.quaternion_multiply(a, b), v)
    np.testing.assert_allclose(turned, geometry.rotate(a, geometry.rotate(b, v)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(turned), np.linalg.norm(v), rtol=1e-9)


@given(vectors, vectors)
def test_great_circle_is_symmetric_and_blind_to_length(u: geometry.Array, v: geometry.Array) -> None:
    there = geometry.great_circle(u, v)
    np.testing.assert_allclose(there, geometry.great_circle(3 * v, 0.1 * u), atol=1e-12)
    assert 0 <= there <= np.pi


@given(vectors, vectors)
def test_axes_changes_are_rotations(u: geometry.Array, v: geometry.Array) -> None:
    """A mirror would flip the cross product: the mistake that turns left into right."""
    for change in (frames.enu_from_t265_vector, frames.enu_from_ned):
        np.testing.assert_allclose(change(np.cross(u, v)), np.cross(change(u), change(v)), atol=1e-9)
    np.testing.assert_array_equal(frames.ned_from_enu(frames.enu_from_ned(v)), v)


@given(angle)
def test_heading_and_yaw_are_inverse(heading: float) -> None:
    back = frames.yaw_ned_from_enu(frames.yaw_enu_from_ned(heading))
    assert abs(np.exp(1j * back) - np.exp(1j * heading)) < 1e-9


@given(angle, unit_quaternions, vectors)
def test_alignment_commutes_with_the_attitude(yaw: float, q: geometry.Array, v: geometry.Array) -> None:
    np.testing.assert_allclose(
        geometry.rotate(frames.yaw_align(yaw, q), v), frames.yaw_align(yaw, geometry.rotate(q, v)), atol=1e-9
    )
