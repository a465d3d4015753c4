"""The table of hand moves against the whole chain from the camera's axes, and the command that walks through it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.pose.hand_moves import MOVES, HandMove, expected_enu_m, judge
from tests.unit.companion.pose.camera_moves import camera_pose
from wsr.geometry import quaternion_from_yaw, quaternion_multiply


@pytest.mark.parametrize("north_deg", [0.0, 40.0, -130.0])
@pytest.mark.parametrize("move", MOVES, ids=lambda move: move.name)
def test_each_move_of_the_camera_is_found_right(move: HandMove, north_deg: float) -> None:
    result = judge(move, *camera_pose(move.name, north_deg), 1.0)
    assert result.problem == ""
    assert result.moved_enu_m == pytest.approx(result.expected_enu_m, abs=1e-9)


@pytest.mark.parametrize("move", MOVES[:3], ids=lambda move: move.name)
def test_a_mirrored_axis_is_found(move: HandMove) -> None:
    assert "180 deg away" in judge(move, *camera_pose(move.name, 10.0, mirrored=True), 1.0).problem


def test_what_a_person_does_wrong_is_told_apart() -> None:
    before, after = camera_pose("forward", 0.0)
    assert "it moved 1.00 m, expected 2.00" in judge(MOVES[0], before, after, 2.0).problem
    w, x, y, z = quaternion_from_yaw(math.radians(130)).tolist()
    assert (
        "turned by +40 deg meanwhile"
        in judge(MOVES[0], before, replace(after, q_enu_from_body=(w, x, y, z)), 1.0).problem
    )
    assert "turned by +0 deg, expected +90" in judge(MOVES[3], before, before, 1.0).problem
    pitch = (math.cos(math.radians(20)), 0.0, math.sin(math.radians(20)), 0.0)
    w, x, y, z = quaternion_multiply(before.q_enu_from_body, pitch).tolist()
    assert "up axis is 40 deg" in judge(MOVES[0], before, replace(after, q_enu_from_body=(w, x, y, z)), 1.0).problem


def test_the_table_of_moves() -> None:
    """Nose to the North: forward is North, left is West. docs/vehicle.md has it, generated."""
    table = {move.name: expected_enu_m(move, math.pi / 2, 1.0) for move in MOVES}
    assert table["forward"] == pytest.approx((0, 1, 0)) and table["left"] == pytest.approx((-1, 0, 0), abs=1e-12)
    assert table["up"] == pytest.approx((0, 0, 1)) and table["turn left"] == (0, 0, 0)
