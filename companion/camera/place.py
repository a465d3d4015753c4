"""Where a tag is in the autopilot's local frame, and how well that is known. Pure.

    p = p_vehicle + R_enu_body (m + R_body_camera c),   S = R S_c R' + s_a^2 (r^2 I - r r') + s_r^2 r r' + s_p^2 I

with c the tag in the camera's axes and S_c its covariance, r the line from the vehicle to the tag, s_a the deviation of
what attitude and mounting are off by, s_r the relative one of a wrong focal length or size of the tag, and s_p that of
the vehicle's own place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.camera.sighting import Tag
from companion.core.messages import Quaternion, Vector3
from wsr.geometry import rotate

_Floats = npt.NDArray[np.float64]
_ATTITUDE_RAD: Final = math.radians(1.5)
_SCALE: Final = 0.02
_OWN_M: Final = 0.05
_BODY_FROM_CAMERA: Final = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Of a camera that looks along the nose: forward is its z, left is against its x, up against its y."""


@dataclass(frozen=True, slots=True)
class TagPlace:
    """Mean (3,) and covariance (3, 3); ENU in the autopilot's local frame. `corners_m2` is the part of the covariance
    that is new with each image; the rest is the same in the next."""

    p_local_enu_m: _Floats
    covariance_m2: _Floats
    corners_m2: _Floats


class Mounting:
    """Of a camera at `position_m` in body axes (forward, left, up), turned from looking along the nose by `yaw_rad` to
    the left, then by `pitch_rad` downwards, then by `roll_rad` clockwise as it looks."""

    def __init__(self, position_m: Vector3, yaw_rad: float, pitch_rad: float, roll_rad: float) -> None:
        self._position_m = np.array(position_m)
        turn = _about(2, yaw_rad) @ _about(1, pitch_rad) @ _about(0, roll_rad)
        self._turn = turn @ _BODY_FROM_CAMERA

    def place(self, tag: Tag, p_local_enu_m: Vector3, q_enu_from_body: Quaternion) -> TagPlace:
        """Of a tag that was seen from there."""
        turn = rotate(q_enu_from_body, np.eye(3)).T  # rows are images of unit vectors
        to_local = turn @ self._turn
        seen_m, other_m = np.array(tag.p_camera_m), np.array(tag.other_p_camera_m)
        line_m = turn @ self._position_m + to_local @ seen_m
        # Which of both poses it is matters little to the centre; where it does, that is a deviation like any other.
        half_m = (other_m - seen_m) / 2 if tag.other_error_px < 2 * tag.error_px + 0.2 else np.zeros(3)
        in_camera = np.array(tag.covariance_m2) + np.outer(half_m, half_m)
        corners = to_local @ in_camera @ to_local.T
        along = np.outer(line_m, line_m)
        aside = np.eye(3) * (line_m @ line_m) - along
        covariance = corners + _ATTITUDE_RAD**2 * aside + _SCALE**2 * along + _OWN_M**2 * np.eye(3)
        return TagPlace(np.array(p_local_enu_m) + line_m, covariance, corners)


def _about(axis: int, angle_rad: float) -> _Floats:
    """Rotation about a body axis, right-handed."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.eye(3)
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn[one, one] = turn[other, other] = c
    turn[one, other], turn[other, one] = -s, s
    return turn
