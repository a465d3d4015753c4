"""A log in the formats of other tools: TUM trajectories, CSV, .dat of the CSI tool, .csi of FeitCSI, NumPy, a rosbag2.

Of a merged log each robot's streams have files of their own, with its name before theirs (`beacon_pose.tum`).
"""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from companion.core.messages import Pose, pose_of
from companion.core.streams import APERTURE, CSI, POSE, POSE_IN, PROFILE, STREAMS, TRUTH, VEHICLE
from companion.errors import CompanionError
from companion.log.foxglove import power_of, time_ns
from companion.log.reader import LoggedMessage, Progress, Session
from companion.log.ros2 import FOLDER, Ros2Exporter
from companion.sensing.records import ApertureRecord
from csi_bridge.encoder import encode_file_record
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.regular_file import read_regular

FORMATS: Final = ("tum", "csv", "dat", "npz")
"""Those that need no extra."""
ROS2: Final = "ros2"
_EXACT: Final = frozenset({".tum", ".csv", ".dat", ".csi"})
"""Files that the same log gives again to the byte."""
_TOPICS: Final = tuple(sorted((stream.topic for stream in STREAMS), key=len, reverse=True))
_TRAJECTORY: Final = POSE.topic + "/"


def export(
    session: Session,
    formats: Sequence[str],
    folder: Path,
    progress: Progress | None = None,
    on_cut: Callable[[Path], None] | None = None,
) -> list[Path]:
    """Writes below `folder`, which is made; what was written. A log without what a format needs gives no file of it.
    `on_cut` is told of each part that is cut off or damaged: what can be read of it is written.

    Raises OSError, and CompanionError for an unreadable log, or where a file of other content is there already: a
    recording's own, or of another log.
    """
    if ROS2 in formats and (folder / FOLDER).exists():
        raise CompanionError(f"{folder / FOLDER}: is there already; a bag is written anew: move it away, or use --out")
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=".", dir=folder) as staging:
            written = _written(session, formats, Path(staging), progress, on_cut=on_cut)
            refuse_other_content({folder / path.name: path for path in written if path.suffix in _EXACT})
            return [path.replace(folder / path.name) for path in written]
    finally:
        if made and not any(folder.iterdir()):
            folder.rmdir()


def refuse_other_content(new: Mapping[Path, Path | bytes]) -> None:
    """Raises CompanionError for a file that is there and would become another one."""
    for path, content in new.items():
        is_there = path.is_file()
        if is_there and read_regular(path) != (read_regular(content) if isinstance(content, Path) else content):
            raise CompanionError(f"{path}: is there already, with other content; choose another folder")


def file_record(data: bytes) -> tuple[str, bytes]:
    """How the files end that hold records such as this one of `/csi`, and how it stands in them: those of FeitCSI one
    behind the other, those of the CSI tool with their length and code before them."""
    code, body = data[0], data[1:]
    return (".csi", body) if code == FEITCSI_CODE else (".dat", encode_file_record(code, body))


def _written(
    session: Session,
    formats: Sequence[str],
    folder: Path,
    progress: Progress | None,
    *,
    on_cut: Callable[[Path], None] | None,
) -> list[Path]:
    exporters = [_EXPORTERS[name](folder) for name in formats]
    try:
        for message in session.messages(progress=progress, on_cut=on_cut) if exporters else ():
            robot, topic = _of_robot(message.topic)
            for exporter in exporters:
                exporter.take(robot, topic, message)
        return [path for exporter in exporters for path in exporter.finish()]
    finally:
        for exporter in exporters:
            if isinstance(exporter, Ros2Exporter):
                exporter.close()


class _Tum:
    """`t x y z qx qy qz qw`, a line a pose: pose.tum of the pose source, vehicle.tum by the autopilot, truth.tum; of a
    recording mocap.tum, t265.tum, odom.tum.

    Times are wall time [s]; orientations are those of the body, identity where a stream has none.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows: dict[str, list[str]] = {}

    def take(self, robot: str, topic: str, message: LoggedMessage) -> None:
        if topic == POSE_IN.topic:
            pose: Pose = pose_of(message.data)
            w, x, y, z = pose.q_enu_from_body
            self._add(robot + "pose", message.publish_time_ns, (*pose.p_enu_m, x, y, z, w))
        elif topic.startswith(_TRAJECTORY):
            kind, t_ns, values = _of_trajectory(topic, message)
            self._add(robot + kind, t_ns, (*values[:3], *values[4:], values[3]))
        elif topic == VEHICLE.topic:
            place = msgspec.json.decode(message.data)
            if place["p_local_enu_m"] is not None and place["yaw_enu_rad"] is not None:
                half = place["yaw_enu_rad"] / 2
                q = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
                self._add(robot + "vehicle", message.publish_time_ns, (*place["p_local_enu_m"], *q))
        elif topic == TRUTH.topic:
            antenna = msgspec.json.decode(message.data)["antenna_enu_m"]
            self._add(robot + "truth", message.publish_time_ns, (*antenna, 0.0, 0.0, 0.0, 1.0))

    def finish(self) -> list[Path]:
        paths = [self._folder / f"{name}.tum" for name in self._rows]
        for path, rows in zip(paths, self._rows.values(), strict=True):
            path.write_text("".join(rows))
        return paths

    def _add(self, name: str, t_ns: int, values: tuple[float, ...]) -> None:
        seconds, nanos = divmod(t_ns, 1_000_000_000)
        numbers = " ".join(f"{value:.9f}" for value in values)
        self._rows.setdefault(name, []).append(f"{seconds}.{nanos:09d} {numbers}\n")


class _Csv:
    """Each stream of JSON messages as a table; nested keys are joined by dots, lists by number."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows: dict[str, list[dict[str, Any]]] = {}

    def take(self, robot: str, topic: str, message: LoggedMessage) -> None:
        if message.encoding == "json":
            row = {"log_time_ns": message.log_time_ns, "event": message.sequence}
            row |= dict(_flat("", msgspec.json.decode(message.data)))
            self._rows.setdefault(message.topic.strip("/").replace("/", "_"), []).append(row)

    def finish(self) -> list[Path]:
        paths = []
        for name, rows in self._rows.items():
            path = self._folder / f"{name}.csv"
            columns = list(dict.fromkeys(key for row in rows for key in row))
            with path.open("w", newline="", encoding="utf-8") as file:
                table = csv.DictWriter(file, columns)
                table.writeheader()
                table.writerows(rows)
            paths.append(path)
        return paths


class _Dat:
    """csi.dat as the CSI tool's logger writes it, or csi.csi as FeitCSI's."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._records: dict[str, list[bytes]] = {}

    def take(self, robot: str, topic: str, message: LoggedMessage) -> None:
        if topic == CSI.topic:
            suffix, record = file_record(message.data)
            self._records.setdefault(f"{robot}csi{suffix}", []).append(record)

    def finish(self) -> list[Path]:
        paths = [self._folder / name for name in self._records]
        for path, records in zip(paths, self._records.values(), strict=True):
            path.write_bytes(b"".join(records))
        return paths


class _Npz:
    """log.npz: `pose_t_ns` (N,), `pose` (N, 10: position, quaternion w x y z, velocity); for aperture i
    `aperture_i_t_s` (M,), `aperture_i_chi_m` (M, 3), `aperture_i_channel` (M,); `profiles` (K, 180, 360). Of a
    recording `mocap_t_ns` (N,), `mocap` (N, 7: position, quaternion w x y z), and so on."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "log.npz"
        self._poses: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        self._arrays: dict[str, Any] = {}
        self._profiles: dict[str, list[Any]] = {}

    def take(self, robot: str, topic: str, message: LoggedMessage) -> None:
        if topic == POSE_IN.topic:
            pose = pose_of(message.data)
            row = (*pose.p_enu_m, *pose.q_enu_from_body, *pose.v_enu_m_s)
            self._poses.setdefault(f"{robot}pose", []).append((pose.t_mono_ns, row))
        elif topic.startswith(_TRAJECTORY):
            kind, t_ns, values = _of_trajectory(topic, message)
            self._poses.setdefault(robot + kind, []).append((t_ns, values))
        elif topic == APERTURE.topic:
            record = msgspec.msgpack.decode(message.data, type=ApertureRecord)
            name = f"{robot}aperture_{record.number}"
            self._arrays[f"{name}_t_s"] = np.frombuffer(record.t_s)
            self._arrays[f"{name}_chi_m"] = np.frombuffer(record.chi_m).reshape(-1, 3)
            self._arrays[f"{name}_channel"] = np.frombuffer(record.channel, np.complex128)
        elif topic == PROFILE.topic:
            self._profiles.setdefault(f"{robot}profiles", []).append(power_of(message.data))

    def finish(self) -> list[Path]:
        for name, poses in self._poses.items():
            self._arrays[f"{name}_t_ns"] = np.array([t_ns for t_ns, _ in poses], np.int64)
            self._arrays[name] = np.array([row for _, row in poses])
        self._arrays |= {name: np.stack(profiles) for name, profiles in self._profiles.items()}
        if not self._arrays:
            return []
        np.savez_compressed(self._path, **self._arrays)
        return [self._path]


_EXPORTERS: Final[Mapping[str, Callable[[Path], _Tum | _Csv | _Dat | _Npz | Ros2Exporter]]] = {
    "tum": _Tum,
    "csv": _Csv,
    "dat": _Dat,
    "npz": _Npz,
    ROS2: Ros2Exporter,
}


def _of_robot(topic: str) -> tuple[str, str]:
    """What stands before the names of files ("beacon_", or nothing), and the topic as the robot itself calls it."""
    for known in _TOPICS:
        if topic.endswith(known):
            robot = topic.removesuffix(known).strip("/").replace("/", "_")
            return (f"{robot}_" if robot else ""), known
    return "", topic


def _of_trajectory(topic: str, message: LoggedMessage) -> tuple[str, int, tuple[float, ...]]:
    """Kind, time and (x, y, z, quaternion w x y z) of a pose of a recording."""
    logged = PoseInFrame.FromString(message.data)
    p, q = logged.pose.position, logged.pose.orientation
    turn = (q.w, q.x, q.y, q.z) if logged.pose.HasField("orientation") else (1.0, 0.0, 0.0, 0.0)
    return topic.removeprefix(_TRAJECTORY).replace("/", "_"), time_ns(logged.timestamp), (p.x, p.y, p.z, *turn)


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{path}.{key}" if path else str(key), item)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _flat(f"{path}.{index}", item)
    else:
        yield path, value
