"""A log in the formats of other tools: TUM trajectories, CSV, .dat of the CSI tool, NumPy."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from companion.log.foxglove import power_of
from companion.log.recording import RECORDING, export_run
from companion.log_reader import LoggedMessage, Progress, Session
from companion.messages import Pose, pose_of
from companion.sar import ApertureRecord
from companion.streams import APERTURE, CSI, POSE_IN, PROFILE, STREAMS, TRUTH, VEHICLE
from csi_bridge.encoder import encode_file_record

FORMATS: Final = ("tum", "csv", "dat", "npz")
_JSON_TOPICS: Final = frozenset(stream.topic for stream in STREAMS if stream.encoding == "json")


def export(session: Session, formats: tuple[str, ...], folder: Path, progress: Progress | None = None) -> list[Path]:
    """Writes below `folder`, which is made; what was written. A log without what a format needs gives no file of it.

    Raises OSError, and CompanionError for an unreadable log.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if session.metadata.get("role") == RECORDING:
        run, _ = export_run(session, folder)
        return sorted(path for path in run.folder.iterdir() if path.is_file())
    exporters = [_EXPORTERS[name](folder) for name in formats]
    for message in session.messages(progress=progress):
        for exporter in exporters:
            exporter.take(message)
    return [path for exporter in exporters for path in exporter.finish()]


class _Tum:
    """`t x y z qx qy qz qw`, a line a pose: pose.tum of the pose source, vehicle.tum by the autopilot, truth.tum.

    Times are wall time [s]; orientations are those of the body, identity where a stream has none.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows: dict[str, list[str]] = {}

    def take(self, message: LoggedMessage) -> None:
        if message.topic == POSE_IN.topic:
            pose: Pose = pose_of(message.data)
            w, x, y, z = pose.q_enu_from_body
            self._add("pose", message.publish_time_ns, (*pose.p_enu_m, x, y, z, w))
        elif message.topic == VEHICLE.topic:
            place = msgspec.json.decode(message.data)
            if place["p_local_enu_m"] is not None and place["yaw_enu_rad"] is not None:
                half = place["yaw_enu_rad"] / 2
                q = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
                self._add("vehicle", message.publish_time_ns, (*place["p_local_enu_m"], *q))
        elif message.topic == TRUTH.topic:
            antenna = msgspec.json.decode(message.data)["antenna_enu_m"]
            self._add("truth", message.publish_time_ns, (*antenna, 0.0, 0.0, 0.0, 1.0))

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

    def take(self, message: LoggedMessage) -> None:
        if message.topic in _JSON_TOPICS:
            row = {"log_time_ns": message.log_time_ns, "event": message.sequence}
            row |= dict(_flat("", msgspec.json.decode(message.data)))
            self._rows.setdefault(message.topic.strip("/").replace("/", "_"), []).append(row)

    def finish(self) -> list[Path]:
        paths = []
        for name, rows in self._rows.items():
            path = self._folder / f"{name}.csv"
            columns = list(dict.fromkeys(key for row in rows for key in row))
            with path.open("w", newline="") as file:
                table = csv.DictWriter(file, columns)
                table.writeheader()
                table.writerows(rows)
            paths.append(path)
        return paths


class _Dat:
    """csi.dat as the CSI tool's logger writes it."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "csi.dat"
        self._records: list[bytes] = []

    def take(self, message: LoggedMessage) -> None:
        if message.topic == CSI.topic:
            self._records.append(encode_file_record(message.data[0], message.data[1:]))

    def finish(self) -> list[Path]:
        if not self._records:
            return []
        self._path.write_bytes(b"".join(self._records))
        return [self._path]


class _Npz:
    """log.npz: `pose_t_ns` (N,), `pose` (N, 10: position, quaternion w x y z, velocity); for aperture i
    `aperture_i_t_s` (M,), `aperture_i_chi_m` (M, 3), `aperture_i_channel` (M,); `profiles` (K, 180, 360)."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "log.npz"
        self._poses: list[Pose] = []
        self._arrays: dict[str, Any] = {}
        self._profiles: list[Any] = []

    def take(self, message: LoggedMessage) -> None:
        if message.topic == POSE_IN.topic:
            self._poses.append(pose_of(message.data))
        elif message.topic == APERTURE.topic:
            record = msgspec.msgpack.decode(message.data, type=ApertureRecord)
            name = f"aperture_{record.number}"
            self._arrays[f"{name}_t_s"] = np.frombuffer(record.t_s)
            self._arrays[f"{name}_chi_m"] = np.frombuffer(record.chi_m).reshape(-1, 3)
            self._arrays[f"{name}_channel"] = np.frombuffer(record.channel, np.complex128)
        elif message.topic == PROFILE.topic:
            self._profiles.append(power_of(message.data))

    def finish(self) -> list[Path]:
        self._arrays["pose_t_ns"] = np.array([pose.t_mono_ns for pose in self._poses], np.int64)
        rows = [(*pose.p_enu_m, *pose.q_enu_from_body, *pose.v_enu_m_s) for pose in self._poses]
        self._arrays["pose"] = np.array(rows).reshape(-1, 10)
        if self._profiles:
            self._arrays["profiles"] = np.stack(self._profiles)
        np.savez_compressed(self._path, **self._arrays)
        return [self._path]


_EXPORTERS: Final[Mapping[str, Callable[[Path], _Tum | _Csv | _Dat | _Npz]]] = {
    "tum": _Tum,
    "csv": _Csv,
    "dat": _Dat,
    "npz": _Npz,
}


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{path}.{key}" if path else str(key), item)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _flat(f"{path}.{index}", item)
    else:
        yield path, value
