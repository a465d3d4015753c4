"""Axes: each test names a motion of the hand and where the world should see it go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wsr import frames
from wsr.geometry import quaternion_from_yaw, quaternion_multiply, rotate, yaw_of

Triple = tuple[float, float, float]
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def _about(axis: int, angle_rad: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    q = np.zeros(4)
    q[0], q[1 + axis] = math.cos(angle_rad / 2), math.sin(angle_rad / 2)
    return q


@pytest.mark.parametrize(
    ("ned", "enu"),
    [((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (1, 0, 0)), ((0, 0, 1), (0, 0, -1)), ((1, 2, 3), (2, 1, -3))],
)
def test_ned_and_enu_with_signs(ned: Triple, enu: Triple) -> None:
    np.testing.assert_array_equal(frames.enu_from_ned(ned), enu)
    np.testing.assert_array_equal(frames.ned_from_enu(enu), ned)
    assert frames.enu_of_ned(*ned) == tuple(enu)
    assert frames.ned_of_enu(*enu) == tuple(ned)


@pytest.mark.parametrize(("compass_deg", "yaw_deg"), [(0, 90), (90, 0), (180, -90), (-90, -180), (45, 45), (300, 150)])
def test_compass_heading_and_yaw(compass_deg: float, yaw_deg: float) -> None:
    assert math.degrees(frames.yaw_enu_from_ned(math.radians(compass_deg))) == pytest.approx(yaw_deg)
    back = math.degrees(frames.yaw_ned_from_enu(math.radians(yaw_deg)))
    assert (back - compass_deg) % 360 == pytest.approx(0, abs=1e-9)


def test_heading_agrees_with_the_vector_it_points_along() -> None:
    heading = math.radians(30)
    nose_enu = frames.enu_from_ned((math.cos(heading), math.sin(heading), 0.0))
    assert math.atan2(nose_enu[1], nose_enu[0]) == pytest.approx(frames.yaw_enu_from_ned(heading))


@pytest.mark.parametrize(
    ("move", "t265_m", "yaw_deg", "enu_m"),
    [
        ("forward 1 m, camera looks north", (0, 0, -1), 0, (0, 1, 0)),
        ("back 1 m, camera looks north", (0, 0, 1), 0, (0, -1, 0)),
        ("right 1 m, camera looks north", (1, 0, 0), 0, (1, 0, 0)),
        ("left 1 m, camera looks north", (-1, 0, 0), 0, (-1, 0, 0)),
        ("up 1 m", (0, 1, 0), 0, (0, 0, 1)),
        ("down 1 m, camera looks west", (0, -1, 0), 90, (0, 0, -1)),
        ("forward 1 m, camera looks west", (0, 0, -1), 90, (-1, 0, 0)),
        ("forward 1 m, camera looks east", (0, 0, -1), -90, (1, 0, 0)),
        ("right 1 m, camera looks west", (1, 0, 0), 90, (0, 1, 0)),
    ],
)
def test_t265_hand_moves(move: str, t265_m: Triple, yaw_deg: float, enu_m: Triple) -> None:
    got = frames.yaw_align(math.radians(yaw_deg), frames.enu_from_t265_vector(t265_m))
    np.testing.assert_allclose(got, enu_m, atol=1e-12, err_msg=move)


def test_t265_at_rest_looks_north_and_is_level() -> None:
    q = frames.enu_from_t265_quaternion(IDENTITY)
    np.testing.assert_allclose(rotate(q, [1, 0, 0]), [0, 1, 0], atol=1e-12)  # forward
    np.testing.assert_allclose(rotate(q, [0, 1, 0]), [-1, 0, 0], atol=1e-12)  # left
    np.testing.assert_allclose(rotate(q, [0, 0, 1]), [0, 0, 1], atol=1e-12)  # up


@pytest.mark.parametrize(
    ("turn", "q_t265", "forward_enu", "up_enu"),
    [
        ("turned left", _about(1, math.pi / 2), (-1, 0, 0), (0, 0, 1)),
        ("nose up", _about(0, math.pi / 2), (0, 0, 1), (0, -1, 0)),
        ("rolled right", _about(2, -math.pi / 2), (0, 1, 0), (1, 0, 0)),
    ],
)
def test_t265_hand_turns(
    turn: str, q_t265: np.ndarray[tuple[int], np.dtype[np.float64]], forward_enu: Triple, up_enu: Triple
) -> None:
    q = frames.enu_from_t265_quaternion(q_t265)
    np.testing.assert_allclose(rotate(q, [1, 0, 0]), forward_enu, atol=1e-12, err_msg=turn)
    np.testing.assert_allclose(rotate(q, [0, 0, 1]), up_enu, atol=1e-12, err_msg=turn)


def test_attitude_and_position_agree() -> None:
    """A step forward along the camera's own axis is a step along body x, whatever the attitude."""
    q_t265 = quaternion_multiply(_about(1, 0.8), _about(0, 0.3))
    step_enu = frames.enu_from_t265_vector(rotate(q_t265, [0, 0, -1]))
    np.testing.assert_allclose(step_enu, rotate(frames.enu_from_t265_quaternion(q_t265), [1, 0, 0]), atol=1e-12)


def test_yaw_is_multiplied_from_the_left() -> None:
    """From the right it would turn a pitched body about its own tilted axis."""
    pitched = quaternion_multiply(quaternion_from_yaw(0.5), _about(1, 0.6))
    aligned = frames.yaw_align(1.0, pitched)
    body = np.array([0.2, -0.5, 0.8])
    np.testing.assert_allclose(rotate(aligned, body), frames.yaw_align(1.0, rotate(pitched, body)), atol=1e-12)
    assert yaw_of(aligned) == pytest.approx(1.5)
    from_the_right = quaternion_multiply(pitched, quaternion_from_yaw(1.0))
    assert np.abs(rotate(from_the_right, body) - rotate(aligned, body)).max() > 0.1


def test_yaw_align_refuses_other_shapes() -> None:
    with pytest.raises(ValueError, match="2 entries"):
        frames.yaw_align(0.0, [1.0, 2.0])
