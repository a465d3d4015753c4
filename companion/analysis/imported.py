"""Recorded runs (CSI of both ends and trajectories) as logs: files in, files out, and analysed from the log.

Topics of such a log: `/csi` at the receiving robot and `/peer/<name>/csi` at each transmitter, records as in a flight's
log (code byte and body), numbered by `sequence`; `/pose/mocap`, `/pose/t265`, `/pose/odom` as PoseInFrame. The metadata
record `recording` holds what is known of the scene.
"""

from __future__ import annotations

import heapq
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from companion.analysis.bearings import analyze_run
from companion.analysis.result import LinkResult, Options, RunResult
from companion.analysis.runs import TRUTH_NAME, RecordingError, Run, find_runs, loose_run, read_truth
from companion.analysis.trajectories import PoseKind, Trajectory, read_trajectory
from companion.core.messages import Vector3
from companion.core.streams import CSI, POSE, Part, Stream
from companion.errors import CompanionError
from companion.log import foxglove
from companion.log.export import export as export_flight
from companion.log.reader import LogScan, Progress, Session
from companion.log.writer import LogWriter
from companion.pose.trajectory_columns import TrajectoryError
from csi_bridge.dat import DatFileError
from csi_bridge.encoder import encode_file_record
from csi_bridge.replay import read_tape

RECORDING: Final = "recording"
_PEER: Final = "/peer/"
_FILES: Final = {".dat": "dat", ".csv": "csv", ".json": "csv"}
"""What of a recording's own files belongs to which format."""
_Timed = tuple[int, int, Stream, object]


@dataclass(frozen=True, slots=True)
class Scene:
    """What a recording is of, as its log's metadata holds it."""

    stamp: str
    set_name: str
    folder: str
    loose: bool
    channel: int | None
    macs: Mapping[str, str] = field(default_factory=dict)
    """Given by the user, by transmitter."""
    lever_m: Vector3 | None = None
    transmitters: Mapping[str, Vector3] = field(default_factory=dict)
    """True positions, in the frame of motion capture."""
    truth_channel: int | None = None
    problems: tuple[str, ...] = ()
    """What was wrong with the files when they were imported."""


def import_run(run: Run, target: Path, options: Options) -> Scene:
    """Writes one run as a log. Problems of single files are in the result. Raises CompanionError when there is no CSI
    of the receiving robot, a file that was given by name cannot be read, or `target` cannot be written."""
    if run.rx is None:
        raise RecordingError(f"{run.folder}: csi_rx_{run.stamp}.dat is missing")
    problems: list[str] = []
    sources = [_csi_messages(run.rx, CSI, problems)]
    sources += [_csi_messages(path, _peer_stream(name), problems) for name, path in run.tx.items()]
    sources += [_pose_messages(path, kind, problems) for kind, path in run.trajectories.items()]
    if run.loose and not all(sources):
        raise RecordingError("; ".join(problems))
    scene = _scene(run, options, problems)
    values = {"scene": msgspec.json.encode(scene).decode()}
    try:
        with target.open("wb") as file:
            writer = LogWriter(file, {"role": RECORDING, "name": run.stamp})
            writer.add_metadata(RECORDING, values)
            for t_ns, number, stream, message in heapq.merge(*sources, key=lambda timed: timed[0]):
                writer.write(stream, t_ns, t_ns, number, message)
            writer.finish()
    except OSError as error:
        raise CompanionError(f"{target}: cannot be written: {error.strerror}") from None
    return scene


def scene_of(session: Session) -> Scene:
    """Raises CompanionError for a log of another kind."""
    scan = LogScan(session.paths[0], ())
    for _ in scan:
        pass
    try:
        return msgspec.json.decode(scan.metadata[RECORDING]["scene"], type=Scene)
    except (KeyError, msgspec.DecodeError):
        raise CompanionError(f"{session.paths[0]}: no imported recording (metadata {RECORDING!r} is missing)") from None


def export(session: Session, formats: Sequence[str], folder: Path, progress: Progress | None = None) -> list[Path]:
    """As `companion.log.export.export`, but that a recording gives its own files again as .dat and CSV."""
    if session.metadata.get("role") != RECORDING:
        return export_flight(session, formats, folder, progress)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = tuple(suffix for suffix, name in _FILES.items() if name in formats)
    written = export_files(session, folder, wanted) if wanted else []
    others = [name for name in formats if name not in _FILES.values()]
    return written + (export_flight(session, others, folder, progress) if others else [])


def export_files(session: Session, folder: Path, wanted: tuple[str, ...]) -> list[Path]:
    """The files of a recording again, those of the suffixes `wanted`: .dat of both ends, trajectories (.csv), truth
    (.json), below `folder` as their data set has them. Raises OSError."""
    scene = scene_of(session)
    place = _place(folder, scene)
    place.mkdir(parents=True, exist_ok=True)
    csi: dict[str, list[tuple[int, bytes]]] = {}
    poses: dict[str, list[str]] = {}
    for message in session.messages():
        if message.topic.endswith(CSI.topic):
            record = encode_file_record(message.data[0], message.data[1:])
            csi.setdefault(_name_of(message.topic), []).append((message.sequence, record))
        elif message.topic.startswith(POSE.topic + "/"):
            poses.setdefault(message.topic.rpartition("/")[2], []).append(_csv_row(message.data))
    files: dict[Path, bytes] = {}
    for name, records in csi.items():
        in_order = sorted(records, key=lambda numbered: numbered[0])
        files[place / f"csi_{name}_{scene.stamp}.dat"] = b"".join(record for _, record in in_order)
    for kind, rows in poses.items():
        prefix = "" if kind == PoseKind.MOCAP else f"{kind}_"
        files[place / f"{prefix}rx_trajectory_{scene.stamp}_.csv"] = "".join(rows).encode()
    if scene.truth_channel is not None:
        files[place / TRUTH_NAME] = _truth_text(scene).encode()
    chosen = {path: content for path, content in files.items() if path.suffix in wanted}
    for path, content in chosen.items():
        path.write_bytes(content)
    return sorted(chosen)


def export_run(session: Session, folder: Path) -> tuple[Run, Scene]:
    """All files of a recording below `folder`, as the run they are. Raises OSError, and CompanionError for a log
    without a run."""
    scene = scene_of(session)
    export_files(session, folder, (".dat", ".csv", ".json"))
    return _run_at(_place(folder, scene), scene), scene


def analyze_session(session: Session, kind: PoseKind | None = None, estimator: str = "robust") -> RunResult:
    """The bearings of a recording's log, by the code of `companion analyze`. Raises CompanionError."""
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        try:
            run, scene = export_run(session, Path(name))
        except OSError as error:
            raise CompanionError(f"{error.filename}: cannot be written: {error.strerror}") from None
        options = Options(kind, scene.channel, dict(scene.macs), scene.lever_m, estimator)
        return _renamed(analyze_run(run, options), name, scene)


def _scene(run: Run, options: Options, problems: list[str]) -> Scene:
    truth = None
    if run.truth is not None:
        try:
            truth = read_truth(run.truth)
        except RecordingError as error:
            problems.append(str(error))
    places = {} if truth is None else {name: _vector(p) for name, p in truth.transmitters.items()}
    return Scene(
        run.stamp,
        run.set_name,
        run.folder.resolve().name,
        run.loose,
        options.channel,
        options.macs,
        options.lever_m,
        places,
        None if truth is None else truth.channel,
        tuple(problems),
    )


def _place(folder: Path, scene: Scene) -> Path:
    return folder / (scene.set_name or "set") / (scene.folder or "run")


def _run_at(place: Path, scene: Scene) -> Run:
    rx = place / f"csi_rx_{scene.stamp}.dat"
    if not scene.loose:
        if not any(place.glob(f"csi_*_{scene.stamp}.dat")):
            raise RecordingError(f"run {scene.stamp}: its log holds no CSI")
        run = next(run for run in find_runs(place) if run.stamp == scene.stamp)
        # Beside it stand no other runs: what is above the folder is not of this recording.
        return replace(run, trajectories={k: p for k, p in run.trajectories.items() if p.parent == place})
    names = {
        path.name.removeprefix("csi_").removesuffix(f"_{scene.stamp}.dat"): path for path in place.glob("csi_*.dat")
    }
    trajectory = next(place.glob("*rx_trajectory*.csv"), None)
    if trajectory is None or not rx.is_file():
        raise RecordingError(
            f"run {scene.stamp}: its log holds no {'CSI of the receiving robot' if trajectory else 'trajectory'}"
        )
    run = loose_run(rx, (), trajectory)
    return replace(run, tx={name: path for name, path in names.items() if name != "rx"}, stamp=scene.stamp)


def _csi_messages(path: Path, stream: Stream, problems: list[str]) -> list[_Timed]:
    """Records of a .dat file, each when it reached the host: wall time, or from 0 on where the driver tells none."""
    try:
        tape = read_tape(path)
    except DatFileError as error:
        problems.append(str(error))
        return []
    times_ns = np.rint(tape.t_s * 1e9).astype(np.int64).tolist()
    messages = [bytes([code]) + body for code, body in tape.records]
    numbered = enumerate(zip(times_ns, messages, strict=True))
    return [(t_ns, number, stream, message) for number, (t_ns, message) in numbered]


def _pose_messages(path: Path, kind: PoseKind, problems: list[str]) -> list[_Timed]:
    try:
        trajectory = read_trajectory(path, kind)
    except TrajectoryError as error:
        problems.append(str(error))
        return []
    problems += trajectory.problems
    stream = Stream(f"{POSE.topic}/{kind}", 200, 0.2, "protobuf", Part.INPUT)
    return [(t_ns, number, stream, pose) for number, (t_ns, pose) in enumerate(_poses(trajectory))]


def _poses(trajectory: Trajectory) -> Iterator[tuple[int, PoseInFrame]]:
    for index, t_s in enumerate(trajectory.t_s.tolist()):
        seconds = int(t_s // 1)
        t_ns = seconds * 1_000_000_000 + round((t_s - seconds) * 1e9)
        x, y, z = trajectory.p_enu_m[index].tolist()
        pose = PoseInFrame(timestamp=foxglove.stamp(t_ns), frame_id=trajectory.kind)
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, y, z
        if trajectory.q_wxyz is not None:
            q = pose.pose.orientation
            q.w, q.x, q.y, q.z = trajectory.q_wxyz[index].tolist()
        yield t_ns, pose


def _csv_row(data: bytes) -> str:
    logged = PoseInFrame.FromString(data)
    p, q = logged.pose.position, logged.pose.orientation
    values = [p.x, p.y, p.z, *((q.x, q.y, q.z, q.w) if logged.pose.HasField("orientation") else ())]
    return f"{logged.timestamp.seconds},{logged.timestamp.nanos}," + ",".join(map(repr, values)) + "\n"


def _truth_text(scene: Scene) -> str:
    positions = {name: {"position": dict(zip("xyz", place, strict=True))} for name, place in scene.transmitters.items()}
    content = {"channel": {"value": scene.truth_channel}, "true_tx_positions": {"value": positions}}
    return json.dumps(content, indent=1)


def _renamed(result: RunResult, folder: str, scene: Scene) -> RunResult:
    """Messages without the name of a folder that is gone."""

    def plain(text: str) -> str:
        return text.replace(folder + "/", "")

    def link(one: LinkResult) -> LinkResult:
        return replace(
            one,
            problem=None if one.problem is None else plain(one.problem),
            truth_problem=None if one.truth_problem is None else plain(one.truth_problem),
            notes=tuple(map(plain, one.notes)),
        )

    problems = tuple(dict.fromkeys((*scene.problems, *map(plain, result.problems))))
    run = replace(result.run, folder=Path(scene.set_name) / scene.folder)
    return replace(
        result,
        run=run,
        links=tuple(map(link, result.links)),
        missing=tuple(map(plain, result.missing)),
        problems=problems,
        failure=None if result.failure is None else plain(result.failure),
        truth_problem=None if result.truth_problem is None else plain(result.truth_problem),
    )


def _peer_stream(name: str) -> Stream:
    return Stream(f"{_PEER}{name}{CSI.topic}", 150, 2.0, "raw", Part.INPUT)


def _name_of(topic: str) -> str:
    return topic.removeprefix(_PEER).removesuffix(CSI.topic) if topic.startswith(_PEER) else "rx"


def _vector(p_m: np.ndarray) -> Vector3:
    x, y, z = (float(value) for value in p_m)
    return x, y, z


def path_of_recording(session: Session, kind: PoseKind | None) -> np.ndarray:
    """Positions (N, 3) of one trajectory of a recording; a single zero where there is none."""
    poses = [PoseInFrame.FromString(m.data).pose.position for m in session.messages({f"{POSE.topic}/{kind}"})]
    return np.array([(p.x, p.y, p.z) for p in poses] or [(0.0, 0.0, 0.0)])
