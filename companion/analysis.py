"""Recorded runs to bearings: the same mathematics as in flight, on CSI of both ends and a recorded trajectory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError
from companion.exchanges import PacketTimes, damage, heard_s, join, read_log, senders, transmitter_mac
from companion.messages import Vector3
from companion.recordings import KNOWN_TRANSMITTERS, TRUTH_NAME, RecordingError, Run, Truth, read_truth
from companion.trajectories import PoseKind, Trajectory, read_trajectory
from csi_bridge.dat import CsiLog
from wsr.aoa import AoaEstimate, Estimator
from wsr.aperture import Aperture, make_aperture
from wsr.channel import wavelength_m
from wsr.displacement import antenna_positions, interpolate
from wsr.errors import ApertureError
from wsr.estimators import ESTIMATORS
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust
from wsr.geometry import angles, direction, great_circle, wrap_angle
from wsr.profile import Profile

OUTSIDE: Final = "outside trajectory"
_MAX_POSE_GAP_S: Final = 0.25
_MAX_DISAGREEMENT_M: Final = 0.1
_MIN_RELIABILITY: Final = 0.1
_MIN_SEEN: Final = 0.8

NO_LEVER: Final[Vector3] = (0.0, 0.0, 0.0)
DEFAULT_LEVERS_M: Final[Mapping[PoseKind, Vector3]] = {
    PoseKind.MOCAP: NO_LEVER,
    PoseKind.T265: NO_LEVER,
    # Of the robot of the WSR data sets: its odometry is that of the wheel base, and motion capture, whose markers are
    # on the antenna, sees that point circle the wheel base at this place; measured by benchmarks/odometry_lever.py.
    PoseKind.ODOM: (0.044, 0.160, 0.0),
}
"""The antenna seen from the tracked point: forward, left, up."""


@dataclass(frozen=True, slots=True)
class Bearing:
    """A direction in ENU: azimuth counter-clockwise from East, polar angle from Up."""

    azimuth_rad: float
    polar_rad: float


@dataclass(frozen=True, slots=True)
class LinkResult:
    """What one transmitter gave. Without an estimate, `problem` says why."""

    name: str
    mac: str | None = None
    packets: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    estimate: AoaEstimate | None = None
    profile: Profile | None = None
    truth: Bearing | None = None
    """From the estimate's own reference point, where that is known in the frame of the true positions."""
    truth_problem: str | None = None
    """Why there is no truth beside an estimate."""
    problem: str | None = None
    notes: tuple[str, ...] = ()
    """What to know about its log and its estimate, where there is one."""
    times: PacketTimes | None = None

    @property
    def used(self) -> int:
        return 0 if self.estimate is None else self.estimate.packets

    @property
    def azimuth_error_rad(self) -> float | None:
        """Estimate less truth, in [-pi, pi)."""
        if self.estimate is None or self.truth is None or not self.estimate.azimuth_observable:
            return None
        return float(wrap_angle(self.estimate.azimuth_rad - self.truth.azimuth_rad))

    @property
    def great_circle_error_rad(self) -> float | None:
        """Angle between estimate and truth; None where the polar angle is not observable."""
        if self.azimuth_error_rad is None or self.estimate is None or not self.estimate.polar_observable:
            return None
        assert self.truth is not None
        u = direction(self.estimate.azimuth_rad, self.estimate.polar_rad)
        return float(great_circle(u, direction(self.truth.azimuth_rad, self.truth.polar_rad)))


@dataclass(frozen=True, slots=True)
class RunResult:
    """What one run gave. Without links either files are `missing` or there is a `failure`."""

    run: Run
    kind: PoseKind | None
    links: tuple[LinkResult, ...] = ()
    missing: tuple[str, ...] = ()
    """Files that are not there, and so the links that need them are not either."""
    problems: tuple[str, ...] = ()
    """What is wrong with files that are used all the same."""
    failure: str | None = None
    """Why no link could be tried, though all files are there."""
    truth_problem: str | None = None
    """Why no link has a truth."""
    lever_m: Vector3 = NO_LEVER
    """Of the antenna, as used."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the user decided. Each None means: as the recording says."""

    kind: PoseKind | None = None
    channel: int | None = None
    macs: Mapping[str, str] = field(default_factory=dict)
    """MAC by transmitter name; only these transmitters, unless it is empty."""
    lever_m: Vector3 | None = None
    estimator: str = "robust"
    """One of `wsr.estimators.ESTIMATORS`."""
    robust: RobustOptions = field(default_factory=RobustOptions)
    """Switches of `robust`, where that is the estimator."""
    as_sent: bool = True
    """The transmitter's channels as its datagrams would have brought them; else as its card reported them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """What the links of a run have in common."""

    rx: CsiLog
    trajectory: Trajectory
    p_antenna_m: npt.NDArray[np.float64]
    mocap: Trajectory | None
    place_problem: str
    """Why there is no motion capture; empty where there is."""
    truth: Truth | None
    wavelength_m: float
    as_sent: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Joined:
    """A link before its estimate: the aperture and its packets' times (M,), or None where `result` says why not."""

    result: LinkResult
    aperture: Aperture | None = None
    t_s: npt.NDArray[np.float64] | None = None


def analyze_run(run: Run, options: Options) -> RunResult:
    """Every transmitter of a run. Problems of single files are in the result; nothing is raised for them."""
    return analyze_run_with(run, options, [_estimator(options)])[0]


def analyze_run_with(run: Run, options: Options, estimators: Sequence[Estimator]) -> list[RunResult]:
    """As `analyze_run`, one result for each of `estimators`; the files are read and joined once."""
    kind = options.kind or next((kind for kind in PoseKind if kind in run.trajectories), None)
    missing = tuple(_missing(run, kind, options.kind))
    lever_m = _lever(kind, options)
    if run.rx is None or kind is None or missing:
        return [RunResult(run, kind, missing=missing, lever_m=lever_m)] * len(estimators)
    problems = list(_second_choice(run, kind, options.kind))
    truth, truth_problem = _truth(run)
    if run.truth is not None and truth_problem is not None:
        problems.append(truth_problem)
    try:
        scene = _scene(run, run.rx, kind, options, truth, problems)
    except CompanionError as error:
        failed = RunResult(
            run, kind, problems=tuple(problems), failure=str(error), truth_problem=truth_problem, lever_m=lever_m
        )
        return [failed] * len(estimators)
    missing = tuple(_without_log(run, scene.rx, options))
    chosen = [name for name in sorted(run.tx) if not options.macs or name in options.macs]
    joined = [_joined(scene, name, run.tx[name], options.macs.get(name)) for name in chosen]
    return [
        RunResult(
            run,
            kind,
            tuple(_estimated(scene, link, estimator) for link in joined),
            missing,
            tuple(problems),
            truth_problem=truth_problem,
            lever_m=lever_m,
        )
        for estimator in estimators
    ]


def _missing(run: Run, kind: PoseKind | None, wanted: PoseKind | None) -> Iterator[str]:
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


def _second_choice(run: Run, kind: PoseKind, wanted: PoseKind | None) -> Iterator[str]:
    if wanted is None and kind is not PoseKind.MOCAP and not run.loose:
        yield f"{_mocap_name(run)} is missing (motion capture); {kind} is used"


def _mocap_name(run: Run) -> str:
    return f"{run.folder}: rx_trajectory_{run.stamp}_.csv"


def _lever(kind: PoseKind | None, options: Options) -> Vector3:
    if options.lever_m is not None:
        return options.lever_m
    return NO_LEVER if kind is None else DEFAULT_LEVERS_M[kind]


def _scene(
    run: Run, rx_path: Path, kind: PoseKind, options: Options, truth: Truth | None, problems: list[str]
) -> _Scene:
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
    p_antenna_m = _antenna(trajectory, _lever(kind, options))
    mocap, place_problem = _mocap(run, trajectory, problems)
    if mocap is not None and mocap is not trajectory:
        problems += _disagreement(trajectory, p_antenna_m, mocap)
    return _Scene(rx, trajectory, p_antenna_m, mocap, place_problem, truth, wavelength, options.as_sent)


def _estimator(options: Options) -> Estimator:
    return Robust(options.robust) if options.estimator == "robust" else ESTIMATORS[options.estimator]()


def _check_overlap(trajectory: Trajectory, packet_t_s: npt.NDArray[np.float64], path: Path) -> None:
    if not np.all(np.isfinite(packet_t_s)):
        raise RecordingError(f"{path}: its records have no host time (stock driver), so no trajectory can be joined")
    if len(packet_t_s) == 0:
        raise RecordingError(f"{path}: no CSI records")
    late_s = float(packet_t_s.min() - trajectory.t_s[-1])
    early_s = float(trajectory.t_s[0] - packet_t_s.max())
    if late_s > 0 or early_s > 0:
        apart = f"ends {late_s:.1f} s before" if late_s > 0 else f"begins {early_s:.1f} s after"
        raise RecordingError(f"{trajectory.path}: no time overlap: the trajectory {apart} the packets of {path.name}")


def _truth(run: Run) -> tuple[Truth | None, str | None]:
    """The truth, or why there is none."""
    if run.truth is None:
        return None, f"{run.folder}: {TRUTH_NAME} is missing, here and in the folder above"
    try:
        return read_truth(run.truth), None
    except RecordingError as error:
        return None, str(error)


def _antenna(trajectory: Trajectory, lever_m: Vector3) -> npt.NDArray[np.float64]:
    if lever_m == NO_LEVER:
        return trajectory.p_enu_m
    if trajectory.q_wxyz is None:
        raise RecordingError(f"{trajectory.path}: has no attitude, so a lever arm cannot be applied")
    return antenna_positions(trajectory.p_enu_m, trajectory.q_wxyz, np.array(lever_m))


def _mocap(run: Run, trajectory: Trajectory, problems: list[str]) -> tuple[Trajectory | None, str]:
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


def _disagreement(trajectory: Trajectory, p_m: npt.NDArray[np.float64], mocap: Trajectory) -> Iterator[str]:
    """Says that a tracker failed, where motion capture shows it; the bearing does not depend on this."""
    seen, valid = interpolate(trajectory.t_s, mocap.t_s, mocap.p_enu_m, _MAX_POSE_GAP_S)
    if np.any(valid):
        apart_m = (p_m - seen)[valid]
        worst_m = float(np.linalg.norm(apart_m - np.median(apart_m, axis=0), axis=1).max())
        if worst_m > _MAX_DISAGREEMENT_M:
            yield f"{trajectory.path}: {worst_m:.2f} m away from motion capture at worst; the tracker drifted or failed"


def _without_log(run: Run, rx: CsiLog, options: Options) -> Iterator[str]:
    """Transmitters that were heard, or asked for, but whose own log is missing."""
    heard = senders(rx)
    known = {} if run.loose else {name: mac for mac, name in KNOWN_TRANSMITTERS.items() if mac in heard}
    wanted = options.macs or known
    for name, mac in wanted.items():
        if name not in run.tx and mac in heard:
            yield f"{run.folder}: csi_{name}_{run.stamp}.dat is missing ({heard[mac]} packets of {name} were heard)"
        elif name not in run.tx:
            yield f"{rx.path}: no packets of {mac}; senders heard: {', '.join(heard) or 'none'}"


def _joined(scene: _Scene, name: str, path: Path, given_mac: str | None) -> _Joined:
    result = LinkResult(name)
    try:
        tx = read_log(path)
        result = replace(result, notes=tuple(damage(tx)))
        mac = transmitter_mac(name, scene.rx, tx, given_mac)
        heard = heard_s(scene.rx, mac)
        result = replace(result, mac=mac, times=PacketTimes(heard))
        exchanges = join(scene.rx, tx, mac, scene.as_sent)
        times = PacketTimes(heard, exchanges.t_s)
        result = replace(result, packets=exchanges.packets, dropped=exchanges.dropped, times=times)
        p_m, inside = interpolate(exchanges.t_s, scene.trajectory.t_s, scene.p_antenna_m, _MAX_POSE_GAP_S)
        if not np.any(inside):
            raise RecordingError(
                f"{scene.trajectory.path}: has no poses less than {_MAX_POSE_GAP_S} s apart while {name} was heard"
            )
        outside = int(np.count_nonzero(~inside))
        result = replace(result, dropped={**exchanges.dropped, **({OUTSIDE: outside} if outside else {})})
        t_s = exchanges.t_s[inside]
        result = replace(result, times=replace(times, used_s=t_s))
        aperture = make_aperture(
            t_s,
            p_m[inside],
            exchanges.channel[inside],
            scene.wavelength_m,
            forward=exchanges.forward[inside],
            reverse=exchanges.reverse[inside],
            nic_us=exchanges.nic_us[inside],
        )
    except (CompanionError, ApertureError) as error:
        return _Joined(replace(result, problem=str(error)))
    return _Joined(result, aperture, t_s)


def _estimated(scene: _Scene, joined: _Joined, estimator: Estimator) -> LinkResult:
    result, aperture = joined.result, joined.aperture
    if aperture is None or joined.t_s is None:
        return result
    try:
        estimate, profile = estimator.estimate(aperture)
    except ApertureError as error:
        return replace(result, problem=str(error))
    notes = (*result.notes, *_doubts(aperture, estimate))
    offset_m = np.subtract(estimate.reference_p_m, aperture.reference_p_m)
    result = replace(result, estimate=estimate, profile=profile, notes=notes)
    try:
        return replace(result, truth=_true_bearing(scene, result.name, joined.t_s, offset_m))
    except _UnknownTruth as error:
        return replace(result, truth_problem=str(error))


def _doubts(aperture: Aperture, estimate: AoaEstimate) -> Iterator[str]:
    if not estimate.azimuth_observable:
        yield f"azimuth not observable: {_unobservable_because(aperture, estimate)}"
    if estimate.reliability < _MIN_RELIABILITY:
        yield f"reliability {estimate.reliability:.3f}: the profile has other peaks as high, or none that stands out"


def _unobservable_because(aperture: Aperture, estimate: AoaEstimate) -> str:
    if aperture.dimension == 1:
        length_m, width_m, _ = aperture.extents_m
        text = f"the path is straight, {length_m:.2f} m long and {width_m:.2f} m wide"
        if estimate.cone is None:
            return text
        angle_deg, std_deg = math.degrees(estimate.cone.angle_rad), math.degrees(estimate.cone.angle_std_rad)
        return f"{text}; the source is {angle_deg:.0f} deg (deviation {std_deg:.0f}) off its direction, on any side"
    # The mirror image of a planar aperture comes first among the alternatives.
    if aperture.dimension == 2 and estimate.alternatives:
        apart_rad = abs(float(wrap_angle(estimate.azimuth_rad - estimate.alternatives[0].azimuth_rad)))
        if apart_rad > estimate.azimuth_std_rad:
            apart_deg = math.degrees(apart_rad)
            return f"the path is a plane, whose mirror image of the direction is {apart_deg:.0f} deg away in azimuth"
    return f"known to {math.degrees(estimate.azimuth_std_rad):.0f} deg only on this path"


class _UnknownTruth(CompanionError):
    """Where the two robots were is not known."""


def _true_bearing(scene: _Scene, name: str, t_s: npt.NDArray[np.float64], offset_m: npt.NDArray[np.float64]) -> Bearing:
    """From the estimate's reference point: the mean true position at the packets plus `offset_m`, which is how far the
    estimator's weights move it. Raises _UnknownTruth."""
    if scene.truth is None:
        raise _UnknownTruth("no true positions")
    if name not in scene.truth.transmitters:
        raise _UnknownTruth(f"{scene.truth.path}: has no position of {name}")
    if scene.mocap is None:
        raise _UnknownTruth(f"the receiver's true place is not known: {scene.place_problem}")
    p_m, inside = interpolate(t_s, scene.mocap.t_s, scene.mocap.p_enu_m, _MAX_POSE_GAP_S)
    # A few packets at the ends that motion capture missed do not move the mean; many would.
    seen = np.count_nonzero(inside)
    if seen < _MIN_SEEN * len(t_s):
        raise _UnknownTruth(
            f"the receiver's true place is not known: {scene.mocap.path}: has poses at {seen} of {len(t_s)} packets"
        )
    azimuth_rad, polar_rad = angles(scene.truth.transmitters[name] - p_m[inside].mean(axis=0) - offset_m)
    return Bearing(float(azimuth_rad), float(polar_rad))
