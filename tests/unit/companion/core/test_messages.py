"""Messages as bytes of the log, and which set points can be sent at all."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import pytest

from companion.core.messages import Pose, Setpoint, pose_bytes, pose_of

POSE = Pose(
    t_mono_ns=1_700_000_000_123_456_789,
    p_enu_m=(1.25, -2.0, 1e-9),
    q_enu_from_body=(0.5, -0.5, 0.5, -0.5),
    v_enu_m_s=(0.1, 0.0, -3.0),
    confidence=3,
)
SETPOINT = Setpoint(7, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.5)


@pytest.mark.parametrize(
    "pose", [POSE, replace(POSE, t_mono_ns=-1, confidence=0), replace(POSE, p_enu_m=(math.inf, 0, 0))]
)
def test_a_pose_comes_back_from_its_bytes_exactly(pose: Pose) -> None:
    data = pose_bytes(pose)
    assert len(data) == 89
    assert pose_of(data) == pose
    assert pose_of(data + b"what a newer version adds") == pose


def test_bytes_that_end_too_soon_are_refused() -> None:
    with pytest.raises(struct.error):
        pose_of(pose_bytes(POSE)[:-1])


def test_the_layout_is_the_documented_one() -> None:
    data = pose_bytes(POSE)
    assert struct.unpack("<q", data[:8]) == (POSE.t_mono_ns,)
    assert struct.unpack("<3d", data[8:32]) == POSE.p_enu_m
    assert struct.unpack("<4d", data[32:64]) == POSE.q_enu_from_body
    assert struct.unpack("<3d", data[64:88]) == POSE.v_enu_m_s
    assert data[88] == POSE.confidence


@pytest.mark.parametrize(
    ("setpoint", "finite"),
    [
        (SETPOINT, True),
        (replace(SETPOINT, p_local_enu_m=None, yaw_enu_rad=None), True),
        (replace(SETPOINT, p_local_enu_m=(0.0, math.nan, 0.0)), False),
        (replace(SETPOINT, v_local_enu_m_s=(0.0, 0.0, math.inf)), False),
        (replace(SETPOINT, yaw_enu_rad=math.nan), False),
    ],
)
def test_a_set_point_is_finite_in_all_that_it_has(setpoint: Setpoint, finite: bool) -> None:
    assert setpoint.is_finite() is finite
