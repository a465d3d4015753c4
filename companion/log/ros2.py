"""A log as a rosbag2 folder (MCAP storage, CDR) of standard ROS 2 messages, by the library `rosbags`.

What each record becomes stands in `ros2_messages`; here are topics, frames and the bag. Imported by the export alone.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from companion.core.streams import TRANSFORMS
from companion.errors import CompanionError
from companion.log.reader import LoggedMessage
from companion.log.ros2_messages import Messages, Rows

FOLDER: Final = "rosbag2"
VERSION: Final = 8
"""Of rosbag2's metadata. Humble and Iron refuse 9 ("bad conversion"), whose quality of service is a list; newer ones
read both."""
_EXTRA: Final = "needs the library rosbags: pip install 'wsr-companion[ros2]'"


def library(name: str, what: str) -> ModuleType:
    """A module of rosbags. Raises CompanionError that names the extra."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and error.name.partition(".")[0] != "rosbags":
            raise
        raise CompanionError(f"{what} {_EXTRA}") from None


class Ros2Exporter:
    """As the other exporters of `companion.log.export`: takes messages, and finishes a folder below `folder`."""

    def __init__(self, folder: Path) -> None:
        rosbag2 = library("rosbags.rosbag2", "--ros2")
        typesys = library("rosbags.typesys", "--ros2")
        self._path = folder / FOLDER
        self._typestore = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._writer = rosbag2.Writer(self._path, version=VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP)
        self._is_open = False
        self._offered = [_offered(library("rosbags.interfaces", "--ros2"))]
        self._messages = Messages(self._typestore.types)
        self._connections: dict[str, Any] = {}

    def take(self, robot: str, topic: str, message: LoggedMessage) -> None:
        self._write(
            f"/{robot[:-1]}" if robot else "", self._messages.of(robot[:-1], topic, message), message.log_time_ns
        )

    def finish(self) -> list[Path]:
        if not self._is_open:
            return []
        self._is_open = False
        self._writer.close()
        return [self._path]

    def close(self) -> None:
        """Lets go of a bag that was not finished."""
        if self._is_open:
            self._is_open = False
            self._writer.abort()

    def _write(self, space: str, rows: Rows, t_ns: int) -> None:
        for name, kind, content in rows:
            # One tree for all robots, whose frames bear their names: tf2 and RViz listen to this topic alone.
            topic = name if name == TRANSFORMS.topic else space + name
            if topic not in self._connections:
                if not self._is_open:
                    self._writer.open()
                    self._is_open = True
                self._connections[topic] = self._writer.add_connection(
                    topic, kind, typestore=self._typestore, offered_qos_profiles=self._offered
                )
            self._writer.write(self._connections[topic], t_ns, self._typestore.serialize_cdr(content, kind))


def _offered(interfaces: ModuleType) -> Any:
    """As a publisher of ROS's own defaults offers: an empty one is not read by every version."""
    ever = interfaces.QosTime(9223372036, 854775807)
    return interfaces.Qos(
        history=interfaces.QosHistory.KEEP_LAST,
        depth=10,
        reliability=interfaces.QosReliability.RELIABLE,
        durability=interfaces.QosDurability.VOLATILE,
        deadline=ever,
        lifespan=ever,
        liveliness=interfaces.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=ever,
        avoid_ros_namespace_conventions=False,
    )
