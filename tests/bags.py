"""rosbag2 folders as ROS 2 would leave them, by the library that also reads them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES: Any = STORE.types
Stamped = tuple[int, tuple[float, ...]]
"""Time [ns] and x, y, z, qx, qy, qz, qw."""


def write_bag(
    path: Path, topics: dict[str, tuple[str, Iterable[Stamped]]], mcap: bool = True, has_stamps: bool = True
) -> Path:
    """`topics`: of each the type (PoseStamped, PoseWithCovarianceStamped, Odometry, String) and its rows."""
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        for topic, (name, rows) in topics.items():
            room = {"Odometry": "nav_msgs", "String": "std_msgs"}.get(name, "geometry_msgs")
            kind = f"{room}/msg/{name}"
            connection = bag.add_connection(topic, kind, typestore=STORE)
            for t_ns, row in rows:
                content = message(name, t_ns if has_stamps else 0, row)
                bag.write(connection, t_ns, STORE.serialize_cdr(content, kind))
    return path


def message(name: str, t_ns: int, row: tuple[float, ...]) -> Any:
    """One message of a kind that `write_bag` knows."""
    if name == "String":
        return TYPES["std_msgs/msg/String"](data="hello")
    x, y, z, qx, qy, qz, qw = row
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
    header = TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id="odom")
    pose: Any = TYPES["geometry_msgs/msg/Pose"](
        position=TYPES["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=TYPES["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
    if name == "PoseStamped":
        return TYPES["geometry_msgs/msg/PoseStamped"](header=header, pose=pose)
    pose = TYPES["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))
    if name == "PoseWithCovarianceStamped":
        return TYPES["geometry_msgs/msg/PoseWithCovarianceStamped"](header=header, pose=pose)
    zero = TYPES["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = TYPES["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
    twist = TYPES["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36))
    return TYPES["nav_msgs/msg/Odometry"](header=header, child_frame_id="base_link", pose=pose, twist=twist)
