"""ODOMETRY both ways: frames, signs, covariances, and what is never sent."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.autopilot.odometry import odometry_fields, pose_from_odometry
from companion.core.messages import Pose
from wsr.geometry import quaternion_from_yaw, quaternion_multiply

_EAST = (1.0, 0.0, 0.0, 0.0)


def _pose(q: tuple[float, ...] = _EAST, v: tuple[float, float, float] = (0.5, 0.0, 0.1), confidence: int = 3) -> Pose:
    return Pose(7_000_001_000, (1.0, 2.0, 3.0), q, v, confidence)  # type: ignore[arg-type]


def test_to_the_autopilot_in_local_ned_and_body_frd() -> None:
    fields = odometry_fields(_pose(), 258, 57_000_001_999)
    assert (fields["frame_id"], fields["child_frame_id"], fields["reset_counter"]) == (1, 12, 2)
    assert (fields["x"], fields["y"], fields["z"]) == (2.0, 1.0, -3.0)
    half = math.sqrt(0.5)
    assert fields["q"] == pytest.approx([half, 0, 0, half]), "nose East: heading 90 degrees"
    assert (fields["vx"], fields["vy"], fields["vz"]) == pytest.approx((0.5, 0.0, -0.1)), "forward and up"
    assert fields["time_usec"] == 57_000_001, "by the vehicle's clock"
    assert len(fields["pose_covariance"]) == len(fields["velocity_covariance"]) == 21


def test_velocity_is_in_body_axes() -> None:
    north = tuple(quaternion_from_yaw(math.pi / 2).tolist())
    fields = odometry_fields(_pose(north, (0.5, 0.0, 0.0)), 0, 1)
    assert (fields["vx"], fields["vy"], fields["vz"]) == pytest.approx((0.0, 0.5, 0.0), abs=1e-12), (
        "East is to its right"
    )


def test_doubt_grows_as_confidence_falls_and_a_failed_tracker_is_not_sent() -> None:
    variances = [odometry_fields(_pose(confidence=c), 0, 1)["pose_covariance"][0] for c in (3, 2, 1)]
    assert 0 < variances[0] < variances[1] < variances[2] < math.inf
    diagonal = np.zeros((6, 6))
    diagonal[np.triu_indices(6)] = odometry_fields(_pose(), 0, 1)["pose_covariance"]
    assert np.count_nonzero(diagonal) == 6 and (np.diag(diagonal) > 0).all()
    with pytest.raises(ValueError, match="failed tracker"):
        odometry_fields(_pose(confidence=0), 0, 1)


def test_there_and_back_again() -> None:
    tilt = quaternion_multiply(quaternion_from_yaw(0.7), [math.cos(0.1), math.sin(0.1), 0.0, 0.0])
    pose = _pose(tuple(tilt.tolist()), (0.3, -0.2, 0.1))
    back = pose_from_odometry(odometry_fields(pose, 0, 1), pose.t_mono_ns)
    assert back.p_enu_m == pytest.approx(pose.p_enu_m)
    assert back.v_enu_m_s == pytest.approx(pose.v_enu_m_s)
    sign = math.copysign(1.0, back.q_enu_from_body[0] * pose.q_enu_from_body[0])
    assert [sign * value for value in back.q_enu_from_body] == pytest.approx(pose.q_enu_from_body)


def test_velocity_in_the_local_frame_is_taken_as_it_is() -> None:
    fields = odometry_fields(_pose(), 0, 1) | {"child_frame_id": 1, "vx": 1.0, "vy": 2.0, "vz": -3.0}
    assert pose_from_odometry(fields, 0).v_enu_m_s == pytest.approx((2.0, 1.0, 3.0))


@pytest.mark.parametrize("wrong", [{"frame_id": 14}, {"child_frame_id": 3}, {"x": math.nan}])
def test_other_frames_and_numbers_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        pose_from_odometry(odometry_fields(_pose(), 0, 1) | wrong, 0)
