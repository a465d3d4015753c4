"""A camera as a person carries it."""

from __future__ import annotations

import math

from companion.core.messages import Pose
from companion.pose import wire
from companion.pose.source import BodyFrame

# In the camera's own axes (X right, Y up, Z back) as it starts: how it moves and turns in each hand move.
CAMERA = {
    "forward": ((0.0, 0.0, -1.0), 0.0),
    "left": ((-1.0, 0.0, 0.0), 0.0),
    "up": ((0.0, 1.0, 0.0), 0.0),
    "turn left": ((0.0, 0.0, 0.0), math.pi / 2),
}


def camera_pose(name: str, north_deg: float, mirrored: bool = False) -> tuple[Pose, Pose]:
    (x, y, z), turn_rad = CAMERA[name]
    frame = BodyFrame(math.radians(north_deg))
    about_y = (math.cos(turn_rad / 2), 0.0, math.sin(turn_rad / 2), 0.0)
    sign = -1.0 if mirrored else 1.0
    at = wire.RawPose(
        t_mono_ns=1,
        position_m=(0.0, 0.0, 0.0),
        quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
        velocity_m_s=(0.0, 0.0, 0.0),
        confidence=3,
        frame=wire.PoseFrame.T265,
    )
    then = at._replace(t_mono_ns=2, position_m=(sign * x, sign * y, sign * z), quaternion_wxyz=about_y)
    return frame.pose(at), frame.pose(then)
