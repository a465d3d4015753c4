"""Recorded runs to bearings: the same mathematics as in flight, on CSI of both ends and a recorded trajectory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.analysis.exchanges import Exchanges, PacketTimes, damage, heard_s, join, read_log, transmitter_mac
from companion.analysis.result import Direction, LinkResult, Options, RunResult
from companion.analysis.runs import RecordingError, Run
from companion.analysis.scene import (
    MAX_POSE_GAP_S,
    RunScene,
    TxPath,
    check_clock,
    lever_of,
    missing_files,
    read_scene,
    second_choice,
    truth_of,
    without_log,
)
from companion.analysis.trajectories import PoseKind
from companion.errors import CompanionError
from csi_bridge.dat import CsiLog
from wsr.aoa import AoaEstimate, Estimator
from wsr.aperture import Aperture, make_aperture
from wsr.displacement import interpolate
from wsr.errors import ApertureError
from wsr.estimators import ESTIMATORS
from wsr.estimators.robust import Robust
from wsr.geometry import angles, wrap_angle

OUTSIDE: Final = "outside trajectory"
OUTSIDE_TX: Final = "outside the transmitter's trajectory"
_MIN_RELIABILITY: Final = 0.1
_MAX_RANGE_M: Final = 1000.0
"""Beyond, no packet is heard: such a truth is in millimetres, or of another frame."""
_MIN_SEEN: Final = 0.8


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
    kind = options.kind or next((kind for kind in PoseKind if kind in {*run.trajectories, *run.ambiguous}), None)
    missing = tuple(missing_files(run, kind, options.kind))
    lever_m = lever_of(kind, options)
    if run.rx is None or kind is None or missing:
        return [RunResult(run=run, kind=kind, missing=missing, lever_m=lever_m)] * len(estimators)
    problems = list(second_choice(run, kind, options.kind))
    truth, truth_problem = truth_of(run)
    if run.truth is not None and truth_problem is not None:
        problems.append(truth_problem)
    try:
        scene = read_scene(run, run.rx, kind, options, truth=truth, problems=problems)
    except CompanionError as error:
        failed = RunResult(
            run=run,
            kind=kind,
            problems=tuple(problems),
            failure=str(error),
            truth_problem=truth_problem,
            lever_m=lever_m,
            trajectory=run.trajectories[kind],
        )
        return [failed] * len(estimators)
    missing = tuple(without_log(run, scene.rx, options))
    chosen = [name for name in sorted(run.tx) if not options.macs or name in options.macs]
    joined = [_joined(scene, name, run.tx[name], options.macs.get(name)) for name in chosen]
    return [
        RunResult(
            run=run,
            kind=kind,
            links=tuple(_estimated(scene, link, estimator) for link in joined),
            missing=missing,
            problems=tuple(problems),
            truth_problem=truth_problem,
            lever_m=lever_m,
            trajectory=scene.trajectory.path,
            layout=scene.trajectory.layout,
        )
        for estimator in estimators
    ]


def _estimator(options: Options) -> Estimator:
    return Robust(options.robust) if options.estimator == "robust" else ESTIMATORS[options.estimator]()


def _joined(scene: RunScene, name: str, path: Path, given_mac: str | None) -> _Joined:
    result = LinkResult(name=name)
    try:
        tx = read_log(path, scene.wanted_tx)
        result = replace(result, notes=tuple(damage(tx)))
        mac = transmitter_mac(name, scene.rx, tx, given_mac)
        heard = heard_s(scene.rx, mac)
        result = replace(result, mac=mac, times=PacketTimes(heard))
        exchanges = join(scene.rx, tx, mac, scene.as_sent)
        times = PacketTimes(heard, exchanges.t_s)
        result = replace(result, packets=exchanges.packets, dropped=exchanges.dropped, times=times)
        p_m, inside = interpolate(exchanges.t_s, scene.trajectory.t_s, scene.p_antenna_m, MAX_POSE_GAP_S)
        if not np.any(inside):
            raise RecordingError(
                f"{scene.trajectory.path}: has no poses less than {MAX_POSE_GAP_S} s apart while {name} was heard"
            )
        dropped = {**exchanges.dropped, OUTSIDE: int(np.count_nonzero(~inside))}
        if name in scene.tx_paths:
            result = replace(result, trajectory=scene.tx_paths[name].trajectory.path)
            p_tx_m, inside_tx = _tx_positions(name, scene.tx_paths[name], tx, exchanges)
            dropped[OUTSIDE_TX] = int(np.count_nonzero(inside & ~inside_tx))
            inside &= inside_tx
            if not np.any(inside):
                raise RecordingError(f"{scene.trajectory.path}: has no poses while {name}'s trajectory has some")
            # chi = (p_i - p_i0) - (p_j - p_j0): what the transmitter did, the receiver did the other way.
            p_m = p_m - (p_tx_m - p_tx_m[inside][0])
        result = replace(result, dropped={reason: count for reason, count in dropped.items() if count})
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
            subcarrier_hz=None if exchanges.grid is None else exchanges.grid.hz,
            half_turns=exchanges.half_turns,
        )
    except (CompanionError, ApertureError) as error:
        return _Joined(replace(result, problem=str(error)))
    return _Joined(result, aperture, t_s)


def _tx_positions(
    name: str, path: TxPath, tx: CsiLog, exchanges: Exchanges
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Where the transmitter's antenna was (K, 3) at each exchange, and whether that is known (K,). Its own host stamped
    both its poses and its packets."""
    trajectory = path.trajectory
    check_clock(tx, trajectory)
    p_m, inside = interpolate(exchanges.tx_t_s, trajectory.t_s, path.p_antenna_m, MAX_POSE_GAP_S)
    if not np.any(inside):
        apart_s = float(np.median(exchanges.t_s - exchanges.tx_t_s))
        raise RecordingError(
            f"{trajectory.path}: has no poses less than {MAX_POSE_GAP_S} s apart while {name} was heard: it spans "
            f"{trajectory.t_s[0]:.3f} to {trajectory.t_s[-1]:.3f}, the packets {exchanges.tx_t_s.min():.3f} to "
            f"{exchanges.tx_t_s.max():.3f} on {name}'s clock, which is {-apart_s:+.3f} s to the receiver's; "
            f"--tx-time-offset {name}=S moves its stamps"
        )
    return p_m, inside


def _estimated(scene: RunScene, joined: _Joined, estimator: Estimator) -> LinkResult:
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
        return replace(result, truth=_true_direction(scene, result.name, joined.t_s, offset_m))
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


def _true_direction(
    scene: RunScene, name: str, t_s: npt.NDArray[np.float64], offset_m: npt.NDArray[np.float64]
) -> Direction:
    """From the estimate's reference point: the mean true position at the packets plus `offset_m`, which is how far the
    estimator's weights move it. Raises _UnknownTruth."""
    if scene.truth is None:
        raise _UnknownTruth("no true positions")
    if name in scene.tx_paths:
        raise _UnknownTruth(f"{scene.truth.path}: has one place of {name}, which moves")
    if name not in scene.truth.transmitters:
        raise _UnknownTruth(f"{scene.truth.path}: has no position of {name}")
    if scene.mocap is None:
        raise _UnknownTruth(f"the receiver's true place is not known: {scene.place_problem}")
    p_m, inside = interpolate(t_s, scene.mocap.t_s, scene.mocap.p_enu_m, MAX_POSE_GAP_S)
    # A few packets at the ends that motion capture missed do not move the mean; many would.
    seen = np.count_nonzero(inside)
    if seen < _MIN_SEEN * len(t_s):
        raise _UnknownTruth(
            f"the receiver's true place is not known: {scene.mocap.path}: has poses at {seen} of {len(t_s)} packets"
        )
    there_m = scene.truth.transmitters[name] - p_m[inside].mean(axis=0) - offset_m
    apart_m = float(np.linalg.norm(there_m))
    if apart_m > _MAX_RANGE_M:
        raise _UnknownTruth(
            f"{scene.truth.path}: {name} is {apart_m:.0f} m from the receiver; expected metres, and below "
            f"{_MAX_RANGE_M:.0f}"
        )
    azimuth_rad, polar_rad = angles(there_m)
    return Direction(float(azimuth_rad), float(polar_rad))
