"""A good pose of a robot that stands or flies level, nose to the East."""

from __future__ import annotations

from companion.core.messages import Pose, Vector3


def level_pose(t_mono_ns: int, p_enu_m: Vector3, v_enu_m_s: Vector3 = (0.0, 0.0, 0.0)) -> Pose:
    """Of full confidence."""
    return Pose(
        t_mono_ns=t_mono_ns,
        p_enu_m=p_enu_m,
        q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
        v_enu_m_s=v_enu_m_s,
        confidence=3,
    )
