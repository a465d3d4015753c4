"""Recorded runs (CSI of both ends and trajectories) as logs: files in, files out, and analysed from the log.

Topics of such a log: `/csi` at the receiving robot and `/peer/<name>/csi` at each transmitter, records as in a flight's
log (code byte and body), numbered by `sequence`; `/pose/mocap`, `/pose/t265`, `/pose/odom` as PoseInFrame, and
`/peer/<name>/pose` of a transmitter that moves, as their files stamp them. The metadata
record `recording` holds what is known of the scene.
"""

from __future__ import annotations

import heapq
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from companion.analysis.bearings import analyze_run
from companion.analysis.exchanges import hears_itself, own_card
from companion.analysis.result import LinkResult, Options, RunResult
from companion.analysis.runs import TRUTH_NAME, RecordingError, Run, find_runs, loose_run, printable, read_truth
from companion.analysis.scene import missing_files
from companion.analysis.trajectories import PoseKind, RecordedTrajectory, guess_kind, read_trajectory
from companion.core.messages import Vector3
from companion.core.streams import CSI, POSE, Part, Stream
from companion.errors import CompanionError
from companion.host.whole_file import whole_file
from companion.log import foxglove
from companion.log.export import export as export_flight
from companion.log.export import file_record, refuse_other_content
from companion.log.reader import LogScan, Progress, Session
from companion.log.writer import LogWriter
from companion.pose.trajectory_columns import TrajectoryError
from csi_bridge.dat_frames import DatFileError
from csi_bridge.replay import read_tape

RECORDING: Final = "recording"
_PEER: Final = "/peer/"
_TX_TRAJECTORY: Final = "_tx_trajectory_"
_FILES: Final = {".dat": "dat", ".csi": "dat", ".csv": "csv", ".json": "csv"}
"""What of a recording's own files belongs to which format."""
_Timed = tuple[int, int, Stream, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedScene:
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
    time_offset_s: float = 0.0
    tx_time_offsets_s: Mapping[str, float] = field(default_factory=dict)
    tx_levers_m: Mapping[str, Vector3] = field(default_factory=dict)
    """As given by the user; the trajectories are as their files stamped them."""


def import_run(run: Run, target: Path, options: Options) -> ImportedScene:
    """Writes one run as a log. Problems of single files are in the result. Raises CompanionError when there is no CSI
    of the receiving robot, a file that was given by name cannot be read, a transmitter's log cannot be its own, or
    `target` cannot be written."""
    if run.rx is None:
        raise RecordingError(f"{run.folder}: csi_rx_{run.stamp}.dat is missing")
    for kind in run.ambiguous:
        raise RecordingError(next(missing_files(run, kind, None)))
    problems: list[str] = []
    sources: list[Iterator[_Timed] | None] = [_csi_messages(run.rx, CSI, problems)]
    for name, path in run.tx.items():
        _refuse_foreign(name, run.rx, path, options.macs.get(name))
        sources.append(_csi_messages(path, _peer_stream(name), problems))
    offset_s = options.time_offset_s
    sources += [
        _pose_messages(path, kind, _pose_stream(kind), offset_s, problems=problems)
        for kind, path in run.trajectories.items()
    ]
    for name, path in run.tx_trajectories.items():
        offset_s = options.tx_time_offsets_s.get(name, 0.0)
        sources.append(_pose_messages(path, guess_kind(path), _pose_stream(name, _PEER), offset_s, problems=problems))
    if sources[0] is None or (run.loose and not all(source is not None for source in sources)):
        raise RecordingError("; ".join(problems))
    scene = _scene(run, options, problems)
    values = {"scene": msgspec.json.encode(scene).decode()}
    try:
        with whole_file(target) as file:
            writer = LogWriter(file, {"role": RECORDING, "name": scene.stamp})
            writer.add_metadata(RECORDING, values)
            there = [source for source in sources if source is not None]
            for t_ns, number, stream, message in heapq.merge(*there, key=lambda timed: timed[0]):
                writer.write(stream, t_ns, t_ns, number, message=message)
            writer.finish()
    except OSError as error:
        raise CompanionError(f"{error.filename or target}: cannot be written: {error.strerror}") from None
    return scene


def scene_of(session: Session) -> ImportedScene:
    """Raises CompanionError for a log of another kind."""
    scan = LogScan(session.paths[0], ())
    for _ in scan:
        pass
    try:
        scene = msgspec.json.decode(scan.metadata[RECORDING]["scene"], type=ImportedScene)
    except (KeyError, RecursionError, msgspec.DecodeError):
        raise CompanionError(f"{session.paths[0]}: no imported recording (metadata {RECORDING!r} is missing)") from None
    for name in (scene.stamp, scene.set_name, scene.folder):
        if "/" in name or "\0" in name or name in (".", ".."):
            raise CompanionError(f"{session.paths[0]}: its recording is named {name[:60]!r}; expected a name, no path")
    return scene


def export(
    session: Session,
    formats: Sequence[str],
    folder: Path,
    progress: Progress | None = None,
    *,
    on_cut: Callable[[Path], None] | None = None,
) -> list[Path]:
    """As `companion.log.export.export`, but that a recording gives its own files again as .dat and CSV."""
    if session.metadata.get("role") != RECORDING:
        return export_flight(session, formats, folder, progress, on_cut)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = tuple(suffix for suffix, name in _FILES.items() if name in formats)
    written = export_files(session, folder, wanted, on_cut) if wanted else []
    others = [name for name in formats if name not in _FILES.values()]
    return written + (export_flight(session, others, folder, progress, on_cut) if others else [])


def export_files(
    session: Session, folder: Path, wanted: tuple[str, ...], on_cut: Callable[[Path], None] | None = None
) -> list[Path]:
    """The files of a recording again, those of the suffixes `wanted`: CSI of both ends (.dat, or .csi of an AX card),
    trajectories (.csv), truth (.json), below `folder` as their data set has them. Raises OSError, and CompanionError
    where files of other content are there."""
    scene = scene_of(session)
    place = _place(folder, scene)
    place.mkdir(parents=True, exist_ok=True)
    csi: dict[tuple[str, str], list[tuple[int, bytes]]] = {}
    poses: dict[str, list[str]] = {}
    tx_poses: dict[str, list[str]] = {}
    for message in session.messages(on_cut=on_cut):
        if message.topic.endswith(CSI.topic):
            suffix, record = file_record(message.data)
            csi.setdefault((_name_of(message.topic), suffix), []).append((message.sequence, record))
        elif message.topic.startswith(POSE.topic + "/"):
            poses.setdefault(message.topic.rpartition("/")[2], []).append(_csv_row(message.data))
        elif message.topic.startswith(_PEER) and message.topic.endswith(POSE.topic):
            name = _plain_name(message.topic.removeprefix(_PEER).removesuffix(POSE.topic))
            tx_poses.setdefault(name, []).append(_csv_row(message.data))
    files: dict[Path, bytes] = {}
    for (name, suffix), records in csi.items():
        in_order = sorted(records, key=lambda numbered: numbered[0])
        files[place / f"csi_{name}_{scene.stamp}{suffix}"] = b"".join(record for _, record in in_order)
    for kind, rows in poses.items():
        prefix = "" if kind == PoseKind.MOCAP else f"{kind}_"
        files[place / f"{prefix}rx_trajectory_{scene.stamp}_.csv"] = "".join(rows).encode()
    for name, rows in tx_poses.items():
        files[place / f"{name}{_TX_TRAJECTORY}{scene.stamp}_.csv"] = "".join(rows).encode()
    if scene.truth_channel is not None:
        files[place / TRUTH_NAME] = _truth_text(scene).encode()
    chosen = {path: content for path, content in files.items() if path.suffix in wanted}
    refuse_other_content(chosen)
    for path, content in chosen.items():
        with whole_file(path) as file:
            file.write(content)
    return sorted(chosen)


def export_run(session: Session, folder: Path) -> tuple[Run, ImportedScene]:
    """All files of a recording below `folder`, as the run they are. Raises OSError, and CompanionError for a log
    without a run."""
    scene = scene_of(session)
    export_files(session, folder, tuple(_FILES))
    place = _place(folder, scene)
    moving = {path.name.partition(_TX_TRAJECTORY)[0]: path for path in place.glob(f"*{_TX_TRAJECTORY}*.csv")}
    return replace(_run_at(place, scene), tx_trajectories=moving), scene


def analyze_session(session: Session, kind: PoseKind | None = None, estimator: str = "robust") -> RunResult:
    """The bearings of a recording's log, by the code of `companion analyze`. Raises CompanionError."""
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        try:
            run, scene = export_run(session, Path(name))
        except OSError as error:
            raise CompanionError(f"{error.filename}: cannot be written: {error.strerror}") from None
        options = Options(
            kind=kind,
            channel=scene.channel,
            macs=dict(scene.macs),
            lever_m=scene.lever_m,
            time_offset_s=scene.time_offset_s,
            tx_time_offsets_s=scene.tx_time_offsets_s,
            tx_levers_m=scene.tx_levers_m,
            estimator=estimator,
        )
        return _renamed(analyze_run(run, options), name, scene)


def _scene(run: Run, options: Options, problems: list[str]) -> ImportedScene:
    truth = None
    if run.truth is not None:
        try:
            truth = read_truth(run.truth)
        except RecordingError as error:
            problems.append(str(error))
    places = {} if truth is None else {name: _vector(p) for name, p in truth.transmitters.items()}
    return ImportedScene(
        stamp=printable(run.stamp),
        set_name=run.set_name,
        folder=printable(run.folder.resolve().name),
        loose=run.loose,
        channel=options.channel,
        macs=options.macs,
        lever_m=options.lever_m,
        transmitters=places,
        truth_channel=None if truth is None else truth.channel,
        problems=tuple(map(printable, problems)),
        time_offset_s=options.time_offset_s,
        tx_time_offsets_s=options.tx_time_offsets_s,
        tx_levers_m=options.tx_levers_m,
    )


def _place(folder: Path, scene: ImportedScene) -> Path:
    return folder / (scene.set_name or "set") / (scene.folder or "run")


def _run_at(place: Path, scene: ImportedScene) -> Run:
    ends = (f"_{scene.stamp}.dat", f"_{scene.stamp}.csi")
    logs = {path.name[len("csi_") : -len(ends[0])]: path for path in place.glob("csi_*") if path.name.endswith(ends)}
    if not scene.loose:
        if not logs:
            raise RecordingError(f"run {scene.stamp}: its log holds no CSI")
        run = next(run for run in find_runs(place) if run.stamp == scene.stamp)
        # Beside it stand no other runs: what is above the folder is not of this recording.
        return replace(run, trajectories={k: p for k, p in run.trajectories.items() if p.parent == place})
    rx, trajectory = logs.get("rx"), next(place.glob("*rx_trajectory*.csv"), None)
    if trajectory is None or rx is None:
        raise RecordingError(
            f"run {scene.stamp}: its log holds no {'CSI of the receiving robot' if trajectory else 'trajectory'}"
        )
    run = loose_run(rx, (), trajectory)
    return replace(run, tx={name: path for name, path in logs.items() if name != "rx"}, stamp=scene.stamp)


def _refuse_foreign(name: str, rx: Path, tx: Path, given: str | None) -> None:
    """Raises ExchangeError where the log `tx` holds packets of the card that `name` is known to have."""
    card = own_card(name, given)
    with suppress(DatFileError):  # what cannot be read is said by who imports it
        if card is not None and card in read_tape(tx).senders():
            heard = card in read_tape(rx).senders()
            raise hears_itself(name, card, rx, tx, rx_heard_it=heard, given=given is not None)


def _csi_messages(path: Path, stream: Stream, problems: list[str]) -> Iterator[_Timed] | None:
    """Records of a .dat file, each when it reached the host: wall time, or from 0 on where the driver tells none. None
    where it cannot be read."""
    try:
        tape = read_tape(path)
    except DatFileError as error:
        problems.append(str(error))
        return None
    if tape.malformed_count or tape.skipped_bytes:
        problems.append(f"{path}: {tape.malformed_count} malformed records, {tape.skipped_bytes} bytes skipped")
    times_ns = np.rint(tape.t_s * 1e9).astype(np.int64)
    numbered = enumerate(zip(times_ns, tape.records, strict=True))
    return ((int(t_ns), number, stream, bytes([code]) + body) for number, (t_ns, (code, body)) in numbered)


def _pose_messages(
    path: Path, kind: PoseKind, stream: Stream, offset_s: float, *, problems: list[str]
) -> Iterator[_Timed] | None:
    """Poses as their file stamps them, at the time those stamps are on the packets' clock."""
    try:
        trajectory = read_trajectory(path, kind, may_stand=stream.topic.startswith(_PEER))
    except TrajectoryError as error:
        problems.append(str(error))
        return None
    problems += trajectory.problems
    later_ns = round(offset_s * 1e9)
    return ((max(0, t_ns + later_ns), number, stream, pose) for number, (t_ns, pose) in enumerate(_poses(trajectory)))


def _poses(trajectory: RecordedTrajectory) -> Iterator[tuple[int, PoseInFrame]]:
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


def _truth_text(scene: ImportedScene) -> str:
    positions = {name: {"position": dict(zip("xyz", place, strict=True))} for name, place in scene.transmitters.items()}
    content = {"channel": {"value": scene.truth_channel}, "true_tx_positions": {"value": positions}}
    return json.dumps(content, indent=1)


def _renamed(result: RunResult, folder: str, scene: ImportedScene) -> RunResult:
    """Messages without the name of a folder that is gone."""

    def plain(text: str) -> str:
        return text.replace(folder + "/", "")

    def link(one: LinkResult) -> LinkResult:
        return replace(
            one,
            problem=None if one.problem is None else plain(one.problem),
            truth_problem=None if one.truth_problem is None else plain(one.truth_problem),
            notes=tuple(map(plain, one.notes)),
            trajectory=None if one.trajectory is None else Path(plain(str(one.trajectory))),
        )

    problems = tuple(dict.fromkeys((*scene.problems, *map(plain, result.problems))))
    run = replace(result.run, folder=Path(scene.set_name) / scene.folder)
    return replace(
        result,
        trajectory=None if result.trajectory is None else Path(plain(str(result.trajectory))),
        run=run,
        links=tuple(map(link, result.links)),
        missing=tuple(map(plain, result.missing)),
        problems=problems,
        failure=None if result.failure is None else plain(result.failure),
        truth_problem=None if result.truth_problem is None else plain(result.truth_problem),
    )


def _pose_stream(name: str, before: str = "") -> Stream:
    """Of the receiving robot by kind, of a moving transmitter by name."""
    topic = f"{before}{name}{POSE.topic}" if before else f"{POSE.topic}/{name}"
    return Stream(topic=topic, rate_hz=200, stale_s=0.2, encoding="protobuf", part=Part.INPUT)


def _peer_stream(name: str) -> Stream:
    return Stream(topic=f"{_PEER}{name}{CSI.topic}", rate_hz=150, stale_s=2.0, encoding="raw", part=Part.INPUT)


def _name_of(topic: str) -> str:
    return _plain_name(topic.removeprefix(_PEER).removesuffix(CSI.topic)) if topic.startswith(_PEER) else "rx"


def _plain_name(name: str) -> str:
    """As a part of a file's name, which a topic need not be."""
    return name.replace("/", "_").replace("\0", "_")


def _vector(p_m: np.ndarray) -> Vector3:
    x, y, z = (float(value) for value in p_m)
    return x, y, z


def path_of_recording(session: Session, kind: PoseKind | None) -> np.ndarray:
    """Positions (N, 3) of one trajectory of a recording; a single zero where there is none."""
    poses = [PoseInFrame.FromString(m.data).pose.position for m in session.messages({f"{POSE.topic}/{kind}"})]
    return np.array([(p.x, p.y, p.z) for p in poses] or [(0.0, 0.0, 0.0)])
