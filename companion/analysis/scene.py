"""What the links of a recorded run have in common: the receiver's log, its trajectory, and what is known to be true."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.analysis.exchanges import damage, read_log, senders
from companion.analysis.result import DEFAULT_LEVERS_M, NO_LEVER, Options
from companion.analysis.runs import KNOWN_TRANSMITTERS, TRUTH_NAME, RecordingError, Run, Survey, read_truth
from companion.analysis.trajectories import PoseKind, RecordedTrajectory, read_trajectory
from companion.core.messages import Vector3
from companion.errors import CompanionError
from csi_bridge.dat import CsiLog
from wsr.channel import wavelength_m
from wsr.displacement import antenna_positions, interpolate

MAX_POSE_GAP_S: Final = 0.25
_MAX_DISAGREEMENT_M: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """What the links of a run have in common."""

    rx: CsiLog
    trajectory: RecordedTrajectory
    p_antenna_m: npt.NDArray[np.float64]
    mocap: RecordedTrajectory | None
    place_problem: str
    """Why there is no motion capture; empty where there is."""
    truth: Survey | None
    wavelength_m: float
    as_sent: bool


def missing_files(run: Run, kind: PoseKind | None, wanted: PoseKind | None) -> Iterator[str]:
    """Files without which nothing can be done."""
    if run.rx is None:
        yield f"{run.folder}: csi_rx_{run.stamp}.dat is missing"
    if kind is None:
        yield f"{run.folder}: no trajectory of {run.stamp}, expected rx_trajectory_{run.stamp}_.csv or a T265's"
    elif kind not in run.trajectories:
        available = ", ".join(run.trajectories) or "none"
        yield f"{run.folder}: no {kind} trajectory of {run.stamp} (available: {available})"
    if not run.tx:
        yield f"{run.folder}: no csi_tx<n>_{run.stamp}.dat of any transmitter"


def second_choice(run: Run, kind: PoseKind, wanted: PoseKind | None) -> Iterator[str]:
    if wanted is None and kind is not PoseKind.MOCAP and not run.loose:
        yield f"{_mocap_name(run)} is missing (motion capture); {kind} is used"


def _mocap_name(run: Run) -> str:
    return f"{run.folder}: rx_trajectory_{run.stamp}_.csv"


def lever_of(kind: PoseKind | None, options: Options) -> Vector3:
    if options.lever_m is not None:
        return options.lever_m
    return NO_LEVER if kind is None else DEFAULT_LEVERS_M[kind]


def read_scene(
    run: Run, rx_path: Path, kind: PoseKind, options: Options, truth: Survey | None, problems: list[str]
) -> Scene:
    rx = read_log(rx_path)
    problems += damage(rx)
    channel = truth.channel if options.channel is None and truth is not None else options.channel
    if truth is not None and channel != truth.channel:
        problems.append(f"{truth.path}: says channel {truth.channel}, but {channel} was given and is used")
    if channel is None:
        raise RecordingError(f"{run.folder}: the WiFi channel is not known; give --channel (108 in the WSR data sets)")
    try:
        wavelength = wavelength_m(channel)
    except ValueError as error:
        raise RecordingError(f"{run.folder}: {error}") from None
    trajectory = read_trajectory(run.trajectories[kind], kind)
    problems += trajectory.problems
    _check_overlap(trajectory, rx.host_time_s, rx.path)
    p_antenna_m = _antenna(trajectory, lever_of(kind, options))
    mocap, place_problem = _mocap(run, trajectory, problems)
    if mocap is not None and mocap is not trajectory:
        problems += _disagreement(trajectory, p_antenna_m, mocap)
    return Scene(
        rx=rx,
        trajectory=trajectory,
        p_antenna_m=p_antenna_m,
        mocap=mocap,
        place_problem=place_problem,
        truth=truth,
        wavelength_m=wavelength,
        as_sent=options.as_sent,
    )


def _check_overlap(trajectory: RecordedTrajectory, packet_t_s: npt.NDArray[np.float64], path: Path) -> None:
    if not np.all(np.isfinite(packet_t_s)):
        raise RecordingError(f"{path}: its records have no host time (stock driver), so no trajectory can be joined")
    if len(packet_t_s) == 0:
        raise RecordingError(f"{path}: no CSI records")
    late_s = float(packet_t_s.min() - trajectory.t_s[-1])
    early_s = float(trajectory.t_s[0] - packet_t_s.max())
    if late_s > 0 or early_s > 0:
        apart = f"ends {late_s:.1f} s before" if late_s > 0 else f"begins {early_s:.1f} s after"
        raise RecordingError(f"{trajectory.path}: no time overlap: the trajectory {apart} the packets of {path.name}")


def truth_of(run: Run) -> tuple[Survey | None, str | None]:
    """The truth, or why there is none."""
    if run.truth is None:
        return None, f"{run.folder}: {TRUTH_NAME} is missing, here and in the folder above"
    try:
        return read_truth(run.truth), None
    except RecordingError as error:
        return None, str(error)


def _antenna(trajectory: RecordedTrajectory, lever_m: Vector3) -> npt.NDArray[np.float64]:
    if lever_m == NO_LEVER:
        return trajectory.p_enu_m
    if trajectory.q_wxyz is None:
        raise RecordingError(f"{trajectory.path}: has no attitude, so a lever arm cannot be applied")
    return antenna_positions(trajectory.p_enu_m, trajectory.q_wxyz, np.array(lever_m))


def _mocap(run: Run, trajectory: RecordedTrajectory, problems: list[str]) -> tuple[RecordedTrajectory | None, str]:
    """Motion capture, for the reference point of the truth only, or why there is none."""
    if trajectory.origin_is_true:
        return trajectory, ""
    path = run.trajectories.get(PoseKind.MOCAP)
    if path is None:
        return None, f"{_mocap_name(run)} is missing (motion capture)"
    try:
        return read_trajectory(path, PoseKind.MOCAP), ""
    except CompanionError as error:
        problems.append(str(error))
        return None, str(error)


def _disagreement(
    trajectory: RecordedTrajectory, p_m: npt.NDArray[np.float64], mocap: RecordedTrajectory
) -> Iterator[str]:
    """Says that a tracker failed, where motion capture shows it; the bearing does not depend on this."""
    seen, valid = interpolate(trajectory.t_s, mocap.t_s, mocap.p_enu_m, MAX_POSE_GAP_S)
    if np.any(valid):
        apart_m = (p_m - seen)[valid]
        worst_m = float(np.linalg.norm(apart_m - np.median(apart_m, axis=0), axis=1).max())
        if worst_m > _MAX_DISAGREEMENT_M:
            yield f"{trajectory.path}: {worst_m:.2f} m away from motion capture at worst; the tracker drifted or failed"


def without_log(run: Run, rx: CsiLog, options: Options) -> Iterator[str]:
    """Transmitters that were heard, or asked for, but whose own log is missing."""
    heard = senders(rx)
    known = {} if run.loose else {name: mac for mac, name in KNOWN_TRANSMITTERS.items() if mac in heard}
    wanted = options.macs or known
    for name, mac in wanted.items():
        if name not in run.tx and mac in heard:
            yield f"{run.folder}: csi_{name}_{run.stamp}.dat is missing ({heard[mac]} packets of {name} were heard)"
        elif name not in run.tx:
            yield f"{rx.path}: no packets of {mac}; senders heard: {', '.join(heard) or 'none'}"
