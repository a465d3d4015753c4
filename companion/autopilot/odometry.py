"""ODOMETRY (MAVLink common.xml message 331) to and from `Pose`: VIO to the autopilot, and the autopilot's own odometry.

To PX4 (docs.px4.io, "Using vision or motion capture systems"): frame_id 1 (LOCAL_NED) and child_frame_id 12
(BODY_FRD), velocity in body axes; with the default frame 14 PX4 drops the message silently. Our poses are turned to
North; in LOCAL_FRD (20), which may point anywhere, PX4 1.16 would give up its yaw alignment and with it the global
position that its hold mode needs. Covariances are upper triangles of 6 x 6, row by row: x, y, z,
roll, pitch, yaw.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from companion.core.messages import Pose, Quaternion, Vector3
from wsr.frames import enu_of_ned, ned_from_enu
from wsr.geometry import quaternion_conjugate, quaternion_multiply, rotate

LOCAL_NED: Final = 1
BODY_NED: Final = 8
BODY_FRD: Final = 12
LOCAL_FRD: Final = 20
_ESTIMATOR_VIO: Final = 3
_ROOT_HALF: Final = math.sqrt(0.5)
_Q_NED_FROM_ENU: Final = np.array([0.0, _ROOT_HALF, _ROOT_HALF, 0.0])  # half a turn about North-East
_Q_FLU_FROM_FRD: Final = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about forward
_DIAGONAL: Final = (0, 6, 11, 15, 18, 20)
_POSITION_STD_M: Final = (math.inf, 0.5, 0.15, 0.05)
"""By tracker confidence 0..3. PX4 has floors of its own (EKF2_EVP_NOISE); what counts is that doubt is told."""
_ANGLE_STD_RAD: Final = (math.inf, 0.3, 0.1, 0.03)
_VELOCITY_STD_M_S: Final = (math.inf, 0.5, 0.15, 0.05)


def odometry_fields(pose: Pose, reset_counter: int, vehicle_ns: int) -> dict[str, Any]:
    """Every field of the message for a pose of confidence 1..3. Raises ValueError for a failed tracker (0).

    `vehicle_ns` is the pose's time by the vehicle's own clock. TIMESYNC is answered with that clock too, so the stamp
    is right before PX4 has converged on the answers, when it does not look at it, and after.
    """
    if not 1 <= pose.confidence <= 3:
        raise ValueError(f"confidence {pose.confidence}: a pose of a failed tracker is not forwarded")
    turned = quaternion_multiply(quaternion_multiply(_Q_NED_FROM_ENU, pose.q_enu_from_body), _Q_FLU_FROM_FRD)
    turned = turned if turned[0] >= 0 else -turned  # the same attitude, written with a positive real part
    x, y, z = ned_from_enu(pose.p_enu_m).tolist()
    body = rotate(quaternion_conjugate(turned), ned_from_enu(pose.v_enu_m_s))
    vx, vy, vz = np.asarray(body).tolist()
    std_m, std_rad, std_m_s = (row[pose.confidence] for row in (_POSITION_STD_M, _ANGLE_STD_RAD, _VELOCITY_STD_M_S))
    return {
        "time_usec": vehicle_ns // 1000,
        "frame_id": LOCAL_NED,
        "child_frame_id": BODY_FRD,
        "x": x,
        "y": y,
        "z": z,
        "q": np.asarray(turned).tolist(),
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "rollspeed": None,
        "pitchspeed": None,
        "yawspeed": None,
        "pose_covariance": _covariance((std_m,) * 3 + (std_rad,) * 3),
        "velocity_covariance": _covariance((std_m_s,) * 3 + (std_rad,) * 3),
        "reset_counter": reset_counter & 0xFF,
        "estimator_type": _ESTIMATOR_VIO,
        "quality": round(100 * pose.confidence / 3),
    }


def pose_from_odometry(fields: dict[str, Any], t_mono_ns: int) -> Pose:
    """The autopilot's own odometry as an ENU pose, of confidence 0 where it says that its odometry has failed (quality
    -1). Raises ValueError for a frame or number that is none, KeyError."""
    if fields["frame_id"] not in (LOCAL_NED, LOCAL_FRD):
        raise ValueError(f"ODOMETRY.frame_id {fields['frame_id']}: expected {LOCAL_NED} or {LOCAL_FRD}")
    q_ned_from_frd = w, x, y, z = _finite(fields["q"])
    velocity = _finite(fields[name] for name in ("vx", "vy", "vz"))
    if fields["child_frame_id"] in (BODY_FRD, BODY_NED):
        velocity = _rotated(q_ned_from_frd, velocity)
    elif fields["child_frame_id"] != LOCAL_NED:
        raise ValueError(f"ODOMETRY.child_frame_id {fields['child_frame_id']}: expected {BODY_FRD}")
    # The two half turns of `odometry_fields`, multiplied out.
    attitude = (-_ROOT_HALF * (w + z), -_ROOT_HALF * (x + y), _ROOT_HALF * (y - x), _ROOT_HALF * (z - w))
    position = enu_of_ned(*_finite(fields[name] for name in ("x", "y", "z")))
    confidence = 0 if int(fields.get("quality", 0)) < 0 else 3  # 0 is unknown: PX4 1.16 tells nothing else
    return Pose(
        t_mono_ns=t_mono_ns,
        p_enu_m=position,
        q_enu_from_body=attitude,
        v_enu_m_s=enu_of_ned(*velocity),
        confidence=confidence,
    )


def _rotated(q_wxyz: Quaternion, v: Vector3) -> Vector3:
    """`wsr.geometry.rotate` in plain numbers: this runs at 30 Hz and more, and arrays cost ten times as much."""
    w, rx, ry, rz = q_wxyz
    vx, vy, vz = v
    ax, ay, az = ry * vz - rz * vy, rz * vx - rx * vz, rx * vy - ry * vx
    return (
        vx + 2.0 * (w * ax + ry * az - rz * ay),
        vy + 2.0 * (w * ay + rz * ax - rx * az),
        vz + 2.0 * (w * az + rx * ay - ry * ax),
    )


def _covariance(std: tuple[float, ...]) -> list[float]:
    values = [0.0] * 21
    for index, value in zip(_DIAGONAL, std, strict=True):
        values[index] = value * value
    return values


def _finite(values: Any) -> Any:
    numbers = tuple(map(float, values))
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"{numbers}: expected finite numbers")
    return numbers
