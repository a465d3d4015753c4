"""A trajectory of a rosbag2 (a folder with metadata.yaml, or one .mcap or .db3 file of it), by the library `rosbags`.

Read are PoseStamped, PoseWithCovarianceStamped and Odometry, definitions as the bag has them. What comes out are rows
as those of any other trajectory file, so that the same checks judge them.
"""

from __future__ import annotations

import importlib
import os
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from companion.pose.trajectory_columns import TrajectoryError
from csi_bridge.regular_file import open_regular

_TYPES: Final = {
    "geometry_msgs/msg/PoseStamped": "PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry": "Odometry",
}
_MAGIC: Final = b"\x89MCAP0\r\n"
"""Begins and ends a file."""
_METADATA: Final = "metadata.yaml"
_STORAGES: Final = (".mcap", ".db3")
_NS: Final = 1_000_000_000
_MOST: Final = 10_000_000
"""Messages: two weeks at motion capture's fastest common rate say something else is in there."""
_DAMAGED: Final = (
    ValueError, LookupError, TypeError, ArithmeticError, AttributeError, AssertionError, EOFError, RuntimeError,
    MemoryError, OSError, struct.error,
)  # fmt: skip
"""What the library lets through of bytes that are no bag, beside errors of its own."""


def is_bag(path: Path) -> bool:
    """Whether a path, less a topic behind a #, is a folder with metadata.yaml or a storage file, or named like one."""
    try:
        bag, _ = _parted(path)
        return bag.suffix in _STORAGES or (bag / _METADATA).is_file() or bool(_stored(bag))
    except OSError:  # a name that no file can have
        return False


def read_bag(path: Path, notes: list[str]) -> tuple[str, list[tuple[int, list[float]]]]:
    """What it was taken for, and (number of the message, [t, x, y, z, qx, qy, qz, qw]) in the order of the bag.

    Raises TrajectoryError naming the bag and, where it is about one, the topic or the message.
    """
    bag, topic = _parted(path)
    try:
        bag.stat()
    except OSError as error:
        raise TrajectoryError(f"{bag}: {error.strerror}") from None
    _refuse_what_waits(bag)
    _refuse_unfinished(bag)
    highlevel, typesys = _library("rosbags.highlevel", bag), _library("rosbags.typesys", bag)
    try:
        known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        with highlevel.AnyReader([bag], default_typestore=known) as reader:
            chosen = _chosen(bag, topic, reader.connections)
            kind, name = _TYPES[chosen[0].msgtype], chosen[0].topic
            rows = list(_rows(reader, chosen))
    except TrajectoryError:
        raise
    except _errors(highlevel) as error:
        what = " ".join(str(error).split())[:200] or type(error).__name__
        raise TrajectoryError(f"{bag}: not a rosbag2 that can be read: {what}") from None
    stamped = [(number, values) for number, _, values in rows]
    if rows and all(values[0] == 0 for _, values in stamped):
        notes.append(f"{path}: {name} has no stamps in its headers; the bag's own times are used")
        stamped = [(number, [t_ns / _NS, *values[1:]]) for number, t_ns, values in rows]
    return f"rosbag2, {name} ({kind})", stamped


def _refuse_what_waits(bag: Path) -> None:
    """The library opens the bag's files itself, and would wait for somebody to write into a named pipe."""
    for path in sorted(bag.iterdir()) if bag.is_dir() else [bag]:
        if path.is_dir():
            continue
        try:
            open_regular(path).close()
        except OSError as error:
            raise TrajectoryError(f"{path}: {error.strerror}") from None


def _refuse_unfinished(bag: Path) -> None:
    """A recorder that was killed leaves no metadata, and an MCAP file without its end: ROS's and MCAP's own tools
    mend both."""
    if bag.is_dir() and not (bag / _METADATA).is_file():
        first = next(iter(_stored(bag)), None)
        mended = "" if first is None else f"; or take one file of it, such as {first.name}"
        raise TrajectoryError(f"{bag}: no metadata.yaml: `ros2 bag reindex {bag}` makes it anew{mended}")
    for path in _stored(bag) if bag.is_dir() else [bag]:
        if path.suffix == ".mcap":
            with open_regular(path) as file:
                size = file.seek(0, os.SEEK_END)
                file.seek(max(0, size - len(_MAGIC)))
                is_whole = file.read() == _MAGIC
                file.seek(0)
                if not is_whole and file.read(len(_MAGIC)) == _MAGIC:
                    raise TrajectoryError(
                        f"{path}: its end is missing, the recorder was stopped: `mcap recover` makes it whole"
                    )


def _stored(bag: Path) -> list[Path]:
    """The files of a folder that hold messages."""
    if not bag.is_dir():
        return []
    return sorted(path for path in bag.iterdir() if path.suffix in _STORAGES and not path.is_dir())


def _parted(path: Path) -> tuple[Path, str]:
    """The bag, and the topic asked for, if one was."""
    if path.exists():
        return path, ""
    bag, mark, topic = str(path).partition("#")
    return (Path(bag), f"/{topic.strip('/')}") if mark else (path, "")


def _chosen(bag: Path, topic: str, connections: list[Any]) -> list[Any]:
    """All connections of one topic: an MCAP file has one for each time that its publisher came anew."""
    known: dict[str, list[Any]] = {}
    for one in connections:
        if one.msgtype in _TYPES:
            known.setdefault(one.topic, []).append(one)
    listed = ", ".join(f"{name} ({_TYPES[ones[0].msgtype]})" for name, ones in sorted(known.items()))
    kinds = ", ".join(_TYPES.values())
    if topic and topic not in known:
        raise TrajectoryError(f"{bag}: no topic {topic} with a trajectory; there are: {listed or 'none'}")
    if not known:
        there = ", ".join(sorted({one.msgtype for one in connections})[:10]) or "nothing"
        raise TrajectoryError(f"{bag}: no trajectory; expected one of {kinds}, it holds {there}")
    if not topic and len(known) > 1:
        raise TrajectoryError(f"{bag}: {len(known)} topics with a trajectory; choose one as {bag}#TOPIC: {listed}")
    return known[topic] if topic else next(iter(known.values()))


def _rows(reader: Any, chosen: list[Any]) -> Iterator[tuple[int, int, list[float]]]:
    for number, (connection, t_ns, data) in enumerate(reader.messages(connections=chosen), start=1):
        if number > _MOST:
            raise ValueError(f"more than {_MOST} messages of {connection.topic}")
        message = reader.deserialize(data, connection.msgtype)
        pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        p, q, stamp = pose.position, pose.orientation, message.header.stamp
        yield number, t_ns, [stamp.sec + stamp.nanosec * 1e-9, p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def _library(name: str, bag: Path) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and error.name.partition(".")[0] != "rosbags":
            raise
        raise TrajectoryError(
            f"{bag}: a rosbag2 needs the library rosbags: pip install 'wsr-companion[ros2]'"
        ) from None


def _errors(highlevel: ModuleType) -> tuple[type[Exception], ...]:
    """Of the library, its storages and its compression."""
    # The standard library has it since 3.14; before, rosbags brings one along.
    zstd = importlib.import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    apsw = importlib.import_module("apsw")
    rosbag2, typesys = importlib.import_module("rosbags.rosbag2"), importlib.import_module("rosbags.typesys")
    own = highlevel.AnyReaderError, rosbag2.ReaderError, typesys.TypesysError
    return *_DAMAGED, *own, zstd.ZstdError, apsw.Error
