"""Poses that differ in their yaw."""

from __future__ import annotations

from companion.core.messages import Pose
from wsr.geometry import quaternion_from_yaw


def yawed_pose(t_ns: int, yaw_rad: float, x_m: float = 0.0) -> Pose:
    w, x, y, z = quaternion_from_yaw(yaw_rad).tolist()
    return Pose(
        t_mono_ns=t_ns, p_enu_m=(x_m, 0.0, 0.0), q_enu_from_body=(w, x, y, z), v_enu_m_s=(0.1, 0.1, 0.1), confidence=3
    )
