"""What the links of a recorded run have in common: the receiver's log, its trajectory, and what is known to be true."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.analysis.exchanges import damage, read_log, senders
from companion.analysis.result import DEFAULT_LEVERS_M, NO_LEVER, Options
from companion.analysis.runs import KNOWN_TRANSMITTERS, TRUTH_NAME, RecordingError, Run, Survey, read_truth
from companion.analysis.trajectories import PoseKind, RecordedTrajectory, guess_kind, read_trajectory
from companion.core.messages import Vector3
from companion.errors import CompanionError
from csi_bridge.clock import host_step
from csi_bridge.dat import CsiLog
from csi_bridge.dat_wanted import Wanted
from wsr.channel import band_wavelength_m
from wsr.displacement import antenna_positions, interpolate
from wsr.ofdm import grid

MAX_POSE_GAP_S: Final = 0.25
_MARGIN_S: Final = 60.0
_AROUND: Final = 300
_EDGE_S: Final = 0.2
_MARGIN_COUNTS: Final = 20_000
_MAX_DISAGREEMENT_M: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunScene:
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
    wanted_tx: Wanted
    """What of the transmitters' logs can belong to these packets."""
    tx_paths: Mapping[str, TxPath]


@dataclass(frozen=True, slots=True, eq=False)
class TxPath:
    """Where the antenna of a moving transmitter was."""

    trajectory: RecordedTrajectory
    p_antenna_m: npt.NDArray[np.float64]


def missing_files(run: Run, kind: PoseKind | None, wanted: PoseKind | None) -> Iterator[str]:
    """Files without which nothing can be done."""
    if run.rx is None:
        yield f"{run.folder}: csi_rx_{run.stamp}.dat is missing"
    if kind is None:
        yield f"{run.folder}: no trajectory of {run.stamp}, expected rx_trajectory_{run.stamp}_.csv or a T265's"
    elif kind in run.ambiguous:
        names = " and ".join(path.name for path in run.ambiguous[kind])
        yield f"{run.ambiguous[kind][0].parent}: {names} both fit as {kind} trajectory of {run.stamp}; keep one"
    elif kind not in run.trajectories:
        available = ", ".join(run.trajectories) or "none"
        yield f"{run.folder}: no {kind} trajectory of {run.stamp} (available: {available})"
    if not run.tx:
        yield f"{run.folder}: no csi_tx<n>_{run.stamp}.dat or .csi of any transmitter"


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
    run: Run, rx_path: Path, kind: PoseKind, options: Options, *, truth: Survey | None, problems: list[str]
) -> RunScene:
    rx, trajectory = _read_both(rx_path, run.trajectories[kind], kind, options.time_offset_s, problems=problems)
    channel = truth.channel if options.channel is None and truth is not None else options.channel
    if truth is not None and channel != truth.channel:
        problems.append(f"{truth.path}: says channel {truth.channel}, but {channel} was given and is used")
    if channel is None:
        raise RecordingError(f"{run.folder}: the WiFi channel is not known; give --channel (108 in the WSR data sets)")
    try:
        wavelength = band_wavelength_m(channel, None if rx.subcarrier_hz is None else grid(rx.subcarrier_hz))
    except ValueError as error:
        raise RecordingError(f"{run.folder}: {error}") from None
    p_antenna_m = _antenna(trajectory, lever_of(kind, options))
    mocap, place_problem = _mocap(run, trajectory, problems)
    if mocap is not None and mocap is not trajectory:
        problems += _disagreement(trajectory, p_antenna_m, mocap)
    paths = {name: _tx_path(name, path, options, problems) for name, path in run.tx_trajectories.items()}
    return RunScene(
        rx=rx,
        trajectory=trajectory,
        p_antenna_m=p_antenna_m,
        mocap=mocap,
        place_problem=place_problem,
        truth=truth,
        wavelength_m=wavelength,
        as_sent=options.as_sent,
        wanted_tx=_of_tx(rx),
        tx_paths=paths,
    )


def _read_both(
    rx_path: Path, path: Path, kind: PoseKind, offset_s: float, *, problems: list[str]
) -> tuple[CsiLog, RecordedTrajectory]:
    """The trajectory, and of the log the packets within a minute of it: what the clocks' relation rests on."""
    try:
        trajectory = read_trajectory(path, kind, offset_s)
    except CompanionError:
        read_log(rx_path, Wanted((0.0, 0.0)))  # a log that cannot be read at all is named first
        raise
    span = float(trajectory.t_s[0]) - _MARGIN_S, float(trajectory.t_s[-1]) + _MARGIN_S
    rx = read_log(rx_path, Wanted(span))
    problems += damage(rx)
    problems += trajectory.problems
    _check_overlap(trajectory, rx)
    check_clock(rx, trajectory)
    if rx.left_out_count:
        problems.append(f"{rx_path}: {rx.left_out_count} records more than a minute from the trajectory are not used")
    return rx, trajectory


def _of_tx(rx: CsiLog) -> Wanted:
    """Of a transmitter's log, whose clock is another: the same exchanges by counter, and some beyond; by time where
    there are no counters, since then the clocks agree; all of an AX card, which has neither."""
    if rx.fine_us is not None:
        return Wanted()
    if np.all(rx.frame_count >= 0):
        first, last = np.quantile(rx.frame_count, (0.001, 0.999))
        return Wanted(counters=(int(first) - _MARGIN_COUNTS, int(last) + _MARGIN_COUNTS))
    return Wanted((float(rx.host_time_s.min()) - _MARGIN_S, float(rx.host_time_s.max()) + _MARGIN_S))


def _tx_path(name: str, path: Path, options: Options, problems: list[str]) -> TxPath:
    trajectory = read_trajectory(path, guess_kind(path), options.tx_time_offsets_s.get(name, 0.0), may_stand=True)
    problems += trajectory.problems
    return TxPath(trajectory, _antenna(trajectory, options.tx_levers_m.get(name, NO_LEVER)))


def check_clock(log: CsiLog, trajectory: RecordedTrajectory) -> None:
    """Raises RecordingError where the host's clock was set while the trajectory lasts: the stamps of its poses may have
    moved with it or not, and the poses of the time that was there twice are not known."""
    host_s, begin_s, end_s = log.host_time_s, float(trajectory.t_s[0]), float(trajectory.t_s[-1])
    inside = np.flatnonzero((host_s >= begin_s) & (host_s <= end_s))
    if not len(inside):
        return
    # Where packets cease or begin to be inside in the middle of the trajectory, the step is among their neighbours.
    first, last = int(inside[0]), int(inside[-1]) + 1
    start = max(0, first - _AROUND) if host_s[first] - begin_s > _EDGE_S else first
    stop = last + _AROUND if end_s - host_s[last - 1] > _EDGE_S else last
    step = host_step(log.timestamp_low_us[start:stop], host_s[start:stop])
    if step is None:
        return
    at, step_s = step
    raise RecordingError(
        f"{log.path}: its host's clock was set {'back' if step_s < 0 else 'forward'} by {abs(step_s):.3f} s about "
        f"record {start + at} of those near {trajectory.path.name}: which pose belongs to which packet is not "
        "known; cut the trajectory before or after that"
    )


def _check_overlap(trajectory: RecordedTrajectory, rx: CsiLog) -> None:
    packet_t_s, path = rx.host_time_s, rx.path
    if not np.all(np.isfinite(packet_t_s)):
        which = "stock driver" if rx.fine_us is None else "FeitCSI's driver left it zero"
        raise RecordingError(f"{path}: its records have no host time ({which}), so no trajectory can be joined")
    spans = [] if rx.left_out_s is None else list(rx.left_out_s)
    if len(packet_t_s) == 0 and not spans:
        raise RecordingError(f"{path}: no CSI records")
    if np.any((packet_t_s >= trajectory.t_s[0]) & (packet_t_s <= trajectory.t_s[-1])):
        return
    seen_s = [*spans, *([float(packet_t_s.min()), float(packet_t_s.max())] if len(packet_t_s) else [])]
    late_s, early_s = min(seen_s) - float(trajectory.t_s[-1]), float(trajectory.t_s[0]) - max(seen_s)
    apart = f"ends {late_s:.1f} s before" if late_s > 0 else f"begins {early_s:.1f} s after"
    if late_s <= 0 and early_s <= 0:
        apart = "lies in a gap of"
    raise RecordingError(
        f"{trajectory.path}: no time overlap: the trajectory {apart} the packets of {path.name}. It was read as "
        f"{trajectory.layout}; its stamps are expected on that host's clock, or --time-offset puts them there"
    )


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
    if PoseKind.MOCAP in run.ambiguous:
        return None, next(missing_files(run, PoseKind.MOCAP, None))
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
