"""Messages of the service in the schemas that Foxglove and Lichtblick show without a plug-in.

Frames: `local` is the autopilot's local frame turned to ENU, `body` the vehicle in it, `tracker` the pose source's
frame with ENU axes, `aoa_profile` a plane beside the start on which one degree is one centimetre. A viewer draws
nothing of a frame it cannot relate to the one it shows, so `/tf` relates them all.
"""

from __future__ import annotations

import logging
import math
from typing import Final

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Grid_pb2 import Grid
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Pose_pb2 import Pose as FoxglovePose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion as FoxgloveQuaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector2_pb2 import Vector2
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3 as FoxgloveVector3
from google.protobuf.timestamp_pb2 import Timestamp

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, Quaternion, Vector3, VehicleState
from companion.log.lines import LogLine
from wsr.aoa import AoaEstimate
from wsr.directions import AZIMUTH_RAD, POLAR_RAD

LOCAL: Final = "local"
BODY: Final = "body"
TRACKER: Final = "tracker"
PROFILE_FRAME: Final = "aoa_profile"
_CELL_M: Final = 0.01
_PROFILE_AT_M: Final = (0.0, -3.0, 0.0)  # in the local frame: beside the start, out of the way
_ARROW_M: Final = 1.6
_STEPS: Final = 255
_IDENTITY: Final = (1.0, 0.0, 0.0, 0.0)
_GREEN: Final = Color(r=0.1, g=0.6, b=0.1, a=1.0)
_RED: Final = Color(r=0.9, g=0.1, b=0.1, a=0.6)


def pose_in_frame(t_ns: int, pose: Pose) -> PoseInFrame:
    return PoseInFrame(timestamp=stamp(t_ns), frame_id=TRACKER, pose=_pose(pose.p_enu_m, pose.q_enu_from_body))


def poses_in_frame(t_ns: int, p_m: npt.NDArray[np.float64], frame: str = TRACKER) -> PosesInFrame:
    """A path of positions (N, 3)."""
    poses = [_pose((x, y, z), _IDENTITY) for x, y, z in p_m.tolist()]
    return PosesInFrame(timestamp=stamp(t_ns), frame_id=frame, poses=poses)


def grid(t_ns: int, power: npt.NDArray[np.floating]) -> Grid:
    """An AOA profile (180, 360): rows are polar angles from 0.5 deg, columns azimuths from -180 deg; one byte a cell,
    255 at the peak."""
    peak = float(power.max())
    scale = _STEPS / peak if peak > 0 else 0.0
    cells = np.rint(np.asarray(power, np.float64) * scale).clip(0, _STEPS).astype(np.uint8)
    columns = cells.shape[1]
    field = PackedElementField(name="power", offset=0, type=PackedElementField.UINT8)
    return Grid(
        timestamp=stamp(t_ns),
        frame_id=PROFILE_FRAME,
        pose=_pose((-_CELL_M * columns / 2, 0.0, 0.0), _IDENTITY),
        column_count=columns,
        cell_size=Vector2(x=_CELL_M, y=_CELL_M),
        row_stride=columns,
        cell_stride=1,
        fields=[field],
        data=cells.tobytes(),
    )


def power_of(data: bytes) -> npt.NDArray[np.float32]:
    """The profile (180, 360) of an encoded `Grid`, relative to its peak. Raises ValueError for another shape."""
    decoded = Grid.FromString(data)
    cells = np.frombuffer(decoded.data, np.uint8).reshape(POLAR_RAD.size, AZIMUTH_RAD.size)
    return np.asarray(cells.astype(np.float32) / np.float32(_STEPS))


def transforms(t_ns: int, vehicle: VehicleState, pose: Pose | None = None) -> FrameTransforms | None:
    """Where the autopilot says the vehicle is; None while it does not. The tracker's frame is put where the newest
    `pose` of its source and the autopilot agree, to within the centimetres that the vehicle moves between the two."""
    if vehicle.p_local_enu_m is None or vehicle.yaw_enu_rad is None:
        return None
    half = vehicle.yaw_enu_rad / 2
    turn = FrameTransform(
        timestamp=stamp(t_ns),
        parent_frame_id=LOCAL,
        child_frame_id=BODY,
        translation=_vector(vehicle.p_local_enu_m),
        rotation=_quaternion((math.cos(half), 0.0, 0.0, math.sin(half))),
    )
    plane = FrameTransform(
        timestamp=stamp(t_ns),
        parent_frame_id=LOCAL,
        child_frame_id=PROFILE_FRAME,
        translation=_vector(_PROFILE_AT_M),
        rotation=_quaternion(_IDENTITY),
    )
    turns = [turn, plane]
    if pose is not None and all(map(math.isfinite, pose.p_enu_m)):
        (x, y, z), (a, b, c) = vehicle.p_local_enu_m, pose.p_enu_m
        turns.append(
            FrameTransform(
                timestamp=stamp(t_ns),
                parent_frame_id=LOCAL,
                child_frame_id=TRACKER,
                translation=_vector((x - a, y - b, z - c)),
                rotation=_quaternion(_IDENTITY),
            )
        )
    return FrameTransforms(transforms=turns)


def bearing_arrow(t_ns: int, name: str, p_local_enu_m: Vector3, estimate: AoaEstimate) -> SceneUpdate:
    """An arrow from the reference point along the bearing."""
    arrow = ArrowPrimitive(
        pose=_pose(p_local_enu_m, _along(estimate.azimuth_rad, estimate.polar_rad)),
        shaft_length=_ARROW_M,
        shaft_diameter=0.03,
        head_length=0.15,
        head_diameter=0.08,
        color=_GREEN,
    )
    return SceneUpdate(entities=[SceneEntity(timestamp=stamp(t_ns), frame_id=LOCAL, id=name, arrows=[arrow])])


def target_sphere(t_ns: int, name: str, p_local_enu_m: Vector3, std_m: float) -> SceneUpdate:
    """Where a robot is thought to be, as large as the doubt about its range."""
    size = 2 * min(max(std_m, 0.1), 5.0)
    sphere = SpherePrimitive(
        pose=_pose(p_local_enu_m, _IDENTITY), size=FoxgloveVector3(x=size, y=size, z=size), color=_RED
    )
    return SceneUpdate(entities=[SceneEntity(timestamp=stamp(t_ns), frame_id=LOCAL, id=name, spheres=[sphere])])


def log(t_ns: int, line: LogLine) -> Log:
    levels = (
        (logging.CRITICAL, Log.FATAL),
        (logging.ERROR, Log.ERROR),
        (logging.WARNING, Log.WARNING),
        (logging.INFO, Log.INFO),
    )
    level = next((ours for least, ours in levels if line.level >= least), Log.DEBUG)
    return Log(timestamp=stamp(t_ns), level=level, message=line.text, name=line.name)


def stamp(t_ns: int) -> Timestamp:
    return Timestamp(seconds=t_ns // NS_PER_S, nanos=t_ns % NS_PER_S)


def time_ns(timestamp: Timestamp) -> int:
    return int(timestamp.seconds) * NS_PER_S + int(timestamp.nanos)


def _along(azimuth_rad: float, polar_rad: float) -> Quaternion:
    """Turns x into the direction: about y by (polar angle - 90 deg), then about z by the azimuth."""
    pitch, yaw = (polar_rad - math.pi / 2) / 2, azimuth_rad / 2
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    return (cy * cp, -sy * sp, cy * sp, sy * cp)


def _pose(p_m: Vector3, q_wxyz: Quaternion) -> FoxglovePose:
    return FoxglovePose(position=_vector(p_m), orientation=_quaternion(q_wxyz))


def _vector(p_m: Vector3) -> FoxgloveVector3:
    x, y, z = p_m
    return FoxgloveVector3(x=x, y=y, z=z)


def _quaternion(q_wxyz: Quaternion) -> FoxgloveQuaternion:
    w, x, y, z = q_wxyz
    return FoxgloveQuaternion(w=w, x=x, y=y, z=z)
