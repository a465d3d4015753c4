"""Records of a log as standard ROS 2 messages: which, in which frame, stamped with what.

`types` are the message classes of a typestore of `rosbags`, by name; so nothing here imports that library. ENU and
metres throughout (REP-103), orientations x y z w.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec
import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from companion.core.clock import NS_PER_S
from companion.core.messages import Quaternion, Vector3, pose_of
from companion.core.streams import BEARING, LOG, MISSION, POSE, POSE_IN, SETPOINT, TARGET, TRANSFORMS, TRUTH, VEHICLE
from companion.log.foxglove import BODY, LOCAL, TRACKER, time_ns
from companion.log.reader import LoggedMessage
from companion.log.records import LoggedIteration

Rows = Iterator[tuple[str, str, Any]]
"""Topic, type and message."""
_TRAJECTORY: Final = POSE.topic + "/"
_IDENTITY: Final = (1.0, 0.0, 0.0, 0.0)
_ARROW, _SPHERE = 0, 2
"""visualization_msgs/Marker."""
_ARROW_M: Final = 1.6
_LEVELS: Final = {Log.DEBUG: 10, Log.INFO: 20, Log.WARNING: 30, Log.ERROR: 40, Log.FATAL: 50}
_UNKNOWN: Final = -1.0
"""First element of the covariance of what sensor_msgs/Imu does not know."""


class Messages:
    """Makes them; keeps nothing but the autopilot's newest attitude."""

    def __init__(self, types: Mapping[str, Any]) -> None:
        self._types = types
        self._attitude: Quaternion | None = None
        self._makers = {
            POSE_IN.topic: self._pose,
            VEHICLE.topic: self._vehicle,
            SETPOINT.topic: self._setpoint,
            BEARING.topic: self._bearing,
            TARGET.topic: self._target,
            TRUTH.topic: self._truth,
            MISSION.topic: self._mission,
            TRANSFORMS.topic: self._transforms,
            LOG.topic: self._line,
            "/px4/sensor_combined": self._imu,
            "/px4/vehicle_attitude": self._keep_attitude,
        }

    def of(self, robot: str, topic: str, message: LoggedMessage) -> Rows:
        """What a record becomes; nothing for what has no standard message. Raises what its decoding raises."""
        maker = self._makers.get(topic)
        if maker is not None:
            yield from maker(f"{robot}/" if robot else "", message)
        elif topic.startswith(_TRAJECTORY):
            logged = PoseInFrame.FromString(message.data)
            p, q = logged.pose.position, logged.pose.orientation
            turn = (q.w, q.x, q.y, q.z) if logged.pose.HasField("orientation") else _IDENTITY
            frame = f"{robot}/{TRACKER}" if robot else TRACKER
            yield topic, *self._pose_stamped(frame, time_ns(logged.timestamp), (p.x, p.y, p.z), turn)

    def _pose(self, space: str, message: LoggedMessage) -> Rows:
        pose, t_ns, frame = pose_of(message.data), message.publish_time_ns, space + TRACKER
        yield "/pose", *self._pose_stamped(frame, t_ns, pose.p_enu_m, pose.q_enu_from_body)
        yield "/pose/twist", *self._twist_stamped(frame, t_ns, pose.v_enu_m_s)

    def _vehicle(self, space: str, message: LoggedMessage) -> Rows:
        state, t_ns, frame = msgspec.json.decode(message.data), message.publish_time_ns, space + LOCAL
        if state["p_local_enu_m"] is not None and state["yaw_enu_rad"] is not None:
            turn = _yaw(state["yaw_enu_rad"])
            yield "/vehicle/pose", *self._pose_stamped(frame, t_ns, state["p_local_enu_m"], turn)
        if state["v_local_enu_m_s"] is not None:
            yield "/vehicle/twist", *self._twist_stamped(frame, t_ns, state["v_local_enu_m_s"])

    def _setpoint(self, space: str, message: LoggedMessage) -> Rows:
        setpoint, t_ns, frame = msgspec.json.decode(message.data), message.publish_time_ns, space + LOCAL
        if setpoint["p_local_enu_m"] is not None:
            yaw_rad = setpoint["yaw_enu_rad"]
            turn = _IDENTITY if yaw_rad is None else _yaw(yaw_rad)
            yield "/setpoint", *self._pose_stamped(frame, t_ns, setpoint["p_local_enu_m"], turn)
        yield "/setpoint/twist", *self._twist_stamped(frame, t_ns, setpoint["v_local_enu_m_s"])

    def _bearing(self, space: str, message: LoggedMessage) -> Rows:
        iteration = msgspec.json.decode(message.data, type=LoggedIteration)
        estimate, p_m = iteration.estimate, iteration.p_local_enu_m
        if estimate is None or p_m is None or not estimate.azimuth_observable:
            return
        polar_rad = estimate.polar_rad if estimate.polar_observable else math.pi / 2
        t_ns, frame, turn = message.publish_time_ns, space + LOCAL, _along(estimate.azimuth_rad, polar_rad)
        yield "/bearing", *self._pose_stamped(frame, t_ns, p_m, turn)
        yield (
            "/bearing/reliability",
            "std_msgs/msg/Float64",
            self._new("std_msgs/msg/Float64", data=estimate.reliability),
        )
        arrow = self._marker(
            frame,
            t_ns,
            iteration.peer,
            _ARROW,
            p_m=p_m,
            q_wxyz=turn,
            size=(_ARROW_M, 0.05, 0.1),
            colour=(0.1, 0.6, 0.1),
        )
        yield "/bearing/marker", *self._markers(arrow)

    def _target(self, space: str, message: LoggedMessage) -> Rows:
        report, t_ns, frame = msgspec.json.decode(message.data), message.publish_time_ns, space + LOCAL
        p_m = report["p_local_enu_m"]
        covariance_m2 = np.array(report["target"]["covariance_m2"], float)
        whole = np.zeros((6, 6))
        whole[:3, :3] = covariance_m2
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        pose = self._new(
            "geometry_msgs/msg/PoseWithCovariance", pose=self._place(p_m, _IDENTITY), covariance=whole.ravel()
        )
        yield "/target", kind, self._new(kind, header=self._header(frame, t_ns), pose=pose)
        if np.all(np.isfinite(covariance_m2)):
            turn, std_m = _ellipsoid(covariance_m2)
            size = tuple(float(4 * one) for one in std_m)  # of two deviations to each side
            sphere = self._marker(
                frame, t_ns, report["peer"], _SPHERE, p_m=p_m, q_wxyz=turn, size=size, colour=(0.9, 0.1, 0.1)
            )
            yield "/target/marker", *self._markers(sphere)

    def _truth(self, space: str, message: LoggedMessage) -> Rows:
        p_m = msgspec.json.decode(message.data)["antenna_enu_m"]
        yield "/truth", *self._pose_stamped(space + LOCAL, message.publish_time_ns, p_m, _IDENTITY)

    def _mission(self, space: str, message: LoggedMessage) -> Rows:
        state = msgspec.json.decode(message.data)["next_state"]
        yield "/mission", "std_msgs/msg/String", self._new("std_msgs/msg/String", data=state)

    def _transforms(self, space: str, message: LoggedMessage) -> Rows:
        turns = []
        for one in FrameTransforms.FromString(message.data).transforms:
            if one.child_frame_id not in (BODY, TRACKER):
                continue  # the plane that a profile is drawn on
            p, q = one.translation, one.rotation
            transform = self._new(
                "geometry_msgs/msg/Transform",
                translation=self._vector((p.x, p.y, p.z)),
                rotation=self._quaternion((q.w, q.x, q.y, q.z)),
            )
            header = self._header(space + one.parent_frame_id, time_ns(one.timestamp))
            turns.append(
                self._new(
                    "geometry_msgs/msg/TransformStamped",
                    header=header,
                    child_frame_id=space + one.child_frame_id,
                    transform=transform,
                )
            )
        yield "/tf", "tf2_msgs/msg/TFMessage", self._new("tf2_msgs/msg/TFMessage", transforms=turns)

    def _line(self, space: str, message: LoggedMessage) -> Rows:
        line, kind = Log.FromString(message.data), "rcl_interfaces/msg/Log"
        stamp, level = self._stamp(time_ns(line.timestamp)), _LEVELS.get(line.level, 20)
        content = self._new(
            kind, stamp=stamp, level=level, name=line.name, msg=line.message, file="", function="", line=0
        )
        yield "/rosout", kind, content

    def _keep_attitude(self, space: str, message: LoggedMessage) -> Rows:
        row = msgspec.json.decode(message.data)
        w, x, y, z = (row[f"q[{n}]"] for n in range(4))
        # From NED and forward, right, down to ENU and forward, left, up: half a turn about East + North before, half a
        # turn about x behind.
        half = math.sqrt(0.5)
        self._attitude = _times(_times((0.0, half, half, 0.0), (w, x, y, z)), (0.0, 1.0, 0.0, 0.0))
        return iter(())

    def _imu(self, space: str, message: LoggedMessage) -> Rows:
        row, kind, known = msgspec.json.decode(message.data), "sensor_msgs/msg/Imu", self._attitude is not None
        gyro, force = ([row[f"{name}[{n}]"] for n in range(3)] for name in ("gyro_rad", "accelerometer_m_s2"))
        unknown = np.array([_UNKNOWN, *[0.0] * 8])
        yield (
            "/imu",
            kind,
            self._new(
                kind,
                header=self._header(space + BODY, message.publish_time_ns),
                orientation=self._quaternion(self._attitude or _IDENTITY),
                orientation_covariance=np.zeros(9) if known else unknown,
                angular_velocity=self._vector((gyro[0], -gyro[1], -gyro[2])),
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=self._vector((force[0], -force[1], -force[2])),
                linear_acceleration_covariance=np.zeros(9),
            ),
        )

    def _pose_stamped(self, frame: str, t_ns: int, p_m: Vector3, q_wxyz: Quaternion) -> tuple[str, Any]:
        kind = "geometry_msgs/msg/PoseStamped"
        return kind, self._new(kind, header=self._header(frame, t_ns), pose=self._place(p_m, q_wxyz))

    def _twist_stamped(self, frame: str, t_ns: int, v_m_s: Vector3) -> tuple[str, Any]:
        kind, still = "geometry_msgs/msg/TwistStamped", self._vector((0.0, 0.0, 0.0))
        twist = self._new("geometry_msgs/msg/Twist", linear=self._vector(v_m_s), angular=still)
        return kind, self._new(kind, header=self._header(frame, t_ns), twist=twist)

    def _markers(self, *markers: Any) -> tuple[str, Any]:
        kind = "visualization_msgs/msg/MarkerArray"
        return kind, self._new(kind, markers=list(markers))

    def _marker(
        self,
        frame: str,
        t_ns: int,
        number: int,
        shape: int,
        *,
        p_m: Vector3,
        q_wxyz: Quaternion,
        size: tuple[float, ...],
        colour: Vector3,
    ) -> Any:
        new, (red, green, blue) = self._new, colour
        return new(
            "visualization_msgs/msg/Marker",
            header=self._header(frame, t_ns),
            ns="companion",
            id=number,
            type=shape,
            action=0,
            pose=self._place(p_m, q_wxyz),
            scale=self._vector((size[0], size[1], size[2])),
            color=new("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=0.8),
            lifetime=new("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=new("sensor_msgs/msg/CompressedImage", header=self._header("", 0), format="", data=_NO_BYTES),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=new("visualization_msgs/msg/MeshFile", filename="", data=_NO_BYTES),
            mesh_use_embedded_materials=False,
        )

    def _place(self, p_m: Vector3, q_wxyz: Quaternion) -> Any:
        x, y, z = p_m
        position = self._new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))
        return self._new("geometry_msgs/msg/Pose", position=position, orientation=self._quaternion(q_wxyz))

    def _quaternion(self, q_wxyz: Quaternion) -> Any:
        w, x, y, z = map(float, q_wxyz)
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _vector(self, v: Vector3) -> Any:
        x, y, z = map(float, v)
        return self._new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def _header(self, frame: str, t_ns: int) -> Any:
        return self._new("std_msgs/msg/Header", stamp=self._stamp(t_ns), frame_id=frame)

    def _stamp(self, t_ns: int) -> Any:
        return self._new("builtin_interfaces/msg/Time", sec=t_ns // NS_PER_S, nanosec=t_ns % NS_PER_S)

    def _new(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)


_NO_BYTES: Final = np.zeros(0, np.uint8)


def _yaw(yaw_rad: float) -> Quaternion:
    return math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)


def _along(azimuth_rad: float, polar_rad: float) -> Quaternion:
    """Turns x into the direction: about y by (polar angle - 90 deg), then about z by the azimuth."""
    pitch_rad = (polar_rad - math.pi / 2) / 2
    return _times(_yaw(azimuth_rad), (math.cos(pitch_rad), 0.0, math.sin(pitch_rad), 0.0))


def _ellipsoid(covariance_m2: np.ndarray) -> tuple[Quaternion, np.ndarray]:
    """Orientation of the principal axes, and the deviation along each (3,)."""
    variances, axes = np.linalg.eigh(covariance_m2)
    axes = axes * np.sign(np.linalg.det(axes))  # right-handed
    w = math.sqrt(max(0.0, 1.0 + np.trace(axes))) / 2
    if w < 1e-3:  # half a turn about an axis, which is the eigenvector of 1
        values, vectors = np.linalg.eigh(axes + axes.T)
        x, y, z = vectors[:, int(np.argmax(values))]
        return (0.0, float(x), float(y), float(z)), np.sqrt(np.maximum(variances, 0.0))
    x, y, z = (axes[2, 1] - axes[1, 2], axes[0, 2] - axes[2, 0], axes[1, 0] - axes[0, 1])
    return (w, float(x / (4 * w)), float(y / (4 * w)), float(z / (4 * w))), np.sqrt(np.maximum(variances, 0.0))


def _times(a: Quaternion, b: Quaternion) -> Quaternion:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
