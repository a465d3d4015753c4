"""Hand moves that show whether the axes are right: what each must do to East, North and Up. Pure.

The only proof of a chain of conversions is to move the vehicle and look. The table is for a vehicle whose nose points
along `yaw`; docs/vehicle.md repeats it, generated, and `companion check-axes` asks for each move, live.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.core.messages import Pose, Vector3
from wsr.geometry import rotate, rotation_z, wrap_angle, yaw_of

_DIRECTION_RAD: Final = math.radians(25.0)
_LENGTH: Final = 0.35
_TURN_RAD: Final = math.radians(20.0)


@dataclass(frozen=True, slots=True)
class HandMove:
    """`body` is the move in units of the distance, forward, left, up; `turn_rad` the turn, counter-clockwise."""

    name: str
    instruction: str
    body: Vector3 = (0.0, 0.0, 0.0)
    turn_rad: float = 0.0


MOVES: Final = (
    HandMove(
        "forward", "carry the vehicle {d:g} m forward (where its nose points), without turning it", (1.0, 0.0, 0.0)
    ),
    HandMove("left", "carry it {d:g} m to its left, without turning it", (0.0, 1.0, 0.0)),
    HandMove("up", "lift it by {d:g} m", (0.0, 0.0, 1.0)),
    HandMove("turn left", "turn it a quarter turn to the left, seen from above, on the spot", turn_rad=math.pi / 2),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveResult:
    """What a move did, and what is wrong with that; empty when nothing is."""

    move: HandMove
    moved_enu_m: Vector3
    expected_enu_m: Vector3
    turned_rad: float
    problem: str


def expected_enu_m(move: HandMove, yaw_rad: float, distance_m: float) -> Vector3:
    """The displacement that a move must show when the nose points along `yaw_rad`."""
    x, y, z = (rotation_z(yaw_rad) @ np.array(move.body) * distance_m).tolist()
    return x, y, z


def judge(move: HandMove, before: Pose, after: Pose, distance_m: float) -> MoveResult:
    """Compares two poses, before and after a move by hand."""
    moved = np.subtract(after.p_enu_m, before.p_enu_m)
    wanted = expected_enu_m(move, float(yaw_of(before.q_enu_from_body)), distance_m)
    turned = float(wrap_angle(float(yaw_of(after.q_enu_from_body)) - float(yaw_of(before.q_enu_from_body))))
    problem = _turn_problem(move, turned) if move.turn_rad else _move_problem(moved, np.array(wanted), turned)
    x, y, z = moved.tolist()
    return MoveResult(
        move=move,
        moved_enu_m=(x, y, z),
        expected_enu_m=wanted,
        turned_rad=turned,
        problem=problem or _tilt_problem(after),
    )


def _turn_problem(move: HandMove, turned_rad: float) -> str:
    if abs(wrap_angle(turned_rad - move.turn_rad)) <= _TURN_RAD:
        return ""
    return f"the nose turned by {math.degrees(turned_rad):+.0f} deg, expected {math.degrees(move.turn_rad):+.0f}"


def _move_problem(moved: npt.NDArray[np.float64], wanted: npt.NDArray[np.float64], turned_rad: float) -> str:
    length, distance = float(np.linalg.norm(moved)), float(np.linalg.norm(wanted))
    if abs(turned_rad) > _TURN_RAD:
        return f"it was turned by {math.degrees(turned_rad):+.0f} deg meanwhile; move it again without turning"
    if abs(length - distance) > _LENGTH * distance:
        return f"it moved {length:.2f} m, expected {distance:.2f}"
    angle = math.acos(max(-1.0, min(1.0, float(moved @ wanted) / (length * distance))))
    if angle > _DIRECTION_RAD:
        return f"it moved {math.degrees(angle):.0f} deg away from where it should have"
    return ""


def _tilt_problem(pose: Pose) -> str:
    up = rotate(np.array(pose.q_enu_from_body), np.array([0.0, 0.0, 1.0]))
    tilt = math.degrees(math.acos(max(-1.0, min(1.0, float(up[2])))))
    return "" if tilt < 30 else f"its up axis is {tilt:.0f} deg away from Up; the camera must look forward, level"
