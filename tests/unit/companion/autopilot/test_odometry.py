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
    return Pose(t_mono_ns=7_000_001_000, p_enu_m=(1.0, 2.0, 3.0), q_enu_from_body=q, v_enu_m_s=v, confidence=confidence)  # type: ignore[arg-type]


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


@pytest.mark.parametrize(("quality", "confidence"), [(-1, 0), (0, 3), (1, 3), (100, 3)])
def test_odometry_that_says_it_has_failed_is_that_of_a_failed_tracker(quality: int, confidence: int) -> None:
    """-1 has failed and 0 is not told (MAVLink common.xml)."""
    fields = odometry_fields(_pose(), 0, 1) | {"quality": quality}
    assert pose_from_odometry(fields, 1).confidence == confidence


def test_odometry_without_a_quality_has_not_failed() -> None:
    """The field is an extension: who sends it short of it says nothing of it."""
    fields = odometry_fields(_pose(), 0, 1)
    del fields["quality"]
    assert pose_from_odometry(fields, 0).confidence == 3


def test_velocity_in_the_local_frame_is_taken_as_it_is() -> None:
    fields = odometry_fields(_pose(), 0, 1) | {"child_frame_id": 1, "vx": 1.0, "vy": 2.0, "vz": -3.0}
    assert pose_from_odometry(fields, 0).v_enu_m_s == pytest.approx((2.0, 1.0, 3.0))


@pytest.mark.parametrize("wrong", [{"frame_id": 14}, {"child_frame_id": 3}, {"x": math.nan}])
def test_other_frames_and_numbers_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        pose_from_odometry(odometry_fields(_pose(), 0, 1) | wrong, 0)


@pytest.mark.parametrize(
    ("confidence", "position", "angle", "velocity", "quality"),
    [(1, 0.5, 0.3, 0.5, 33), (2, 0.15, 0.1, 0.15, 67), (3, 0.05, 0.03, 0.05, 100)],
)
def test_each_confidence_has_its_deviations_and_its_quality(
    confidence: int, position: float, angle: float, velocity: float, quality: int
) -> None:
    fields = odometry_fields(_pose(confidence=confidence), 0, 1)
    pose, speed = (np.zeros((6, 6)), np.zeros((6, 6)))
    pose[np.triu_indices(6)], speed[np.triu_indices(6)] = fields["pose_covariance"], fields["velocity_covariance"]
    assert pose == pytest.approx(np.diag([position**2] * 3 + [angle**2] * 3))
    assert speed == pytest.approx(np.diag([velocity**2] * 3 + [angle**2] * 3))
    assert (fields["quality"], fields["estimator_type"]) == (quality, 3), "VIO"


def test_a_confidence_that_no_tracker_has_is_not_sent() -> None:
    with pytest.raises(ValueError, match="confidence 4"):
        odometry_fields(_pose(confidence=4), 0, 1)


@pytest.mark.parametrize("counter", [0, 1, 254, 255, 256, 257, 511])
def test_a_reset_counter_is_one_byte(counter: int) -> None:
    assert odometry_fields(_pose(), counter, 1)["reset_counter"] == counter % 256


@pytest.mark.parametrize("yaw_deg", [-170, -91, -89, -10, 10, 89, 91, 170])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_attitude_is_written_with_a_positive_real_part(yaw_deg: int, sign: float) -> None:
    q = sign * quaternion_from_yaw(math.radians(yaw_deg))
    fields = odometry_fields(_pose(tuple(q.tolist())), 0, 1)
    w, x, y, z = fields["q"]
    assert w > 0 and (x, y) == pytest.approx((0, 0), abs=1e-12)
    assert math.remainder(2 * math.atan2(z, w) - math.radians(90 - yaw_deg), math.tau) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("frame", [1, 20])
@pytest.mark.parametrize(("child", "north_m_s"), [(12, 0.0), (8, 0.0), (1, 0.5)])
def test_frames_that_px4_itself_sends_are_read(frame: int, child: int, north_m_s: float) -> None:
    fields = odometry_fields(_pose(v=(0.5, 0.0, 0.0)), 0, 1) | {"frame_id": frame, "child_frame_id": child}
    pose = pose_from_odometry(fields, 0)
    assert pose.v_enu_m_s[1] == pytest.approx(north_m_s) and pose.confidence == 3


@pytest.mark.parametrize("wrong", [0, 2, 7, 9, 11, 13, 19, 21, 300])
def test_every_other_frame_is_refused(wrong: int) -> None:
    for key in ("frame_id", "child_frame_id"):
        with pytest.raises(ValueError, match="expected"):
            pose_from_odometry(odometry_fields(_pose(), 0, 1) | {key: wrong}, 0)
