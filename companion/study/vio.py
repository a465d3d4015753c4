"""`vio`: a real T265 against motion capture (labels fig:ATE_trans_error_cameraTraj, fig:Mocap_vs_camera_AOA_cdf).

Every recorded run that has both: how far the camera's displacement is off while packets were heard, and what bearings
made with it are worth beside those with motion capture. Nothing is fitted: both start at the same point, with the
heading that the files have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from companion.analysis.bearings import analyze_run
from companion.analysis.exchanges import read_log
from companion.analysis.result import LinkResult, Options
from companion.analysis.runs import Run, find_runs
from companion.analysis.trajectories import PoseKind, read_trajectory
from companion.errors import CompanionError
from companion.study.angles import share_below
from companion.study.figures import MARKERS, draw_cdf
from companion.study.study import Finding, Settings, Study, Summary
from wsr.displacement import interpolate
from wsr.geometry import angles, wrap_angle

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_ESTIMATORS = ("bartlett", "robust")
_KINDS = (PoseKind.MOCAP, PoseKind.T265)
_MAX_GAP_S = 0.25
_STEP_S = 0.02
_CLEAR_OF_START_M = 0.1
"""Nearer to the start the direction of the displacement is noise."""
_FEW = 5
"""Links, up to which a rank correlation says nothing."""
_PAPER = {
    "ate": 0.2,
    "length": 2.8,
    "phi": 7.58,
    "theta": 3.21,
}


@dataclass(frozen=True, slots=True)
class CameraDrift:
    """`ate_m` with the start aligned, `length_m` of path by motion capture, mean |angular drift| about the start
    (definition def:angular-drift)."""

    ate_m: float
    length_m: float
    azimuth_deg: float
    polar_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkErrors:
    """|Azimuth error| and |polar error| [deg] of one transmitter; None without an estimate, or where the path does not
    show the polar angle."""

    tx: str
    estimator: str
    poses: str
    azimuth_deg: float | None
    polar_deg: float | None


@dataclass(frozen=True, slots=True)
class VioRow:
    run: str
    drift: CameraDrift | None
    links: list[LinkErrors]
    problem: str


def _plan(settings: Settings) -> list[Run]:
    """Raises RecordingError when there are no recordings."""
    runs = find_runs(settings.data)
    return [run for run in runs if all(kind in run.trajectories for kind in _KINDS)][: settings.trials]


def _trial(run: Run, seed: SeedSequence) -> VioRow:
    """Nothing is random here."""
    try:
        drift, problem = _drift(run), ""
    except CompanionError as error:
        drift, problem = None, str(error)
    links = []
    for kind in _KINDS:
        for estimator in _ESTIMATORS:
            result = analyze_run(run, Options(kind=kind, estimator=estimator))
            links += [_link(link, estimator, kind) for link in result.links if link.truth is not None]
    return VioRow(run.title, drift, links, problem)


def _drift(run: Run) -> CameraDrift:
    """Raises CompanionError when a file cannot be used or the two do not overlap."""
    assert run.rx is not None
    heard_s = read_log(run.rx).host_time_s
    truth, camera = (read_trajectory(run.trajectories[kind], kind) for kind in _KINDS)
    t_s = np.arange(float(heard_s.min()), float(heard_s.max()), _STEP_S)
    true_m, true_ok = interpolate(t_s, truth.t_s, truth.p_enu_m, _MAX_GAP_S)
    camera_m, camera_ok = interpolate(t_s, camera.t_s, camera.p_enu_m, _MAX_GAP_S)
    both = true_ok & camera_ok
    if np.count_nonzero(both) < 2:
        raise CompanionError(f"{run.title}: motion capture and T265 have no time in common with the packets")
    p, q = true_m[both] - true_m[both][0], camera_m[both] - camera_m[both][0]
    clear = (np.linalg.norm(p, axis=1) > _CLEAR_OF_START_M) & (np.linalg.norm(q, axis=1) > _CLEAR_OF_START_M)
    azimuth, polar = (a[clear] - b[clear] for a, b in zip(angles(p), angles(q), strict=True))
    return CameraDrift(
        math.sqrt(float(np.mean(np.sum((p - q) ** 2, axis=1)))),
        float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum()),
        math.degrees(float(np.mean(np.abs(wrap_angle(azimuth))))) if clear.any() else math.nan,
        math.degrees(float(np.mean(np.abs(polar)))) if clear.any() else math.nan,
    )


def _link(link: LinkResult, estimator: str, kind: PoseKind) -> LinkErrors:
    azimuth = polar = None
    if link.estimate is not None and link.truth is not None:
        azimuth = abs(math.degrees(float(wrap_angle(link.estimate.azimuth_rad - link.truth.azimuth_rad))))
        if link.estimate.polar_observable:
            polar = abs(math.degrees(link.estimate.polar_rad - link.truth.polar_rad))
    return LinkErrors(tx=link.name, estimator=estimator, poses=str(kind), azimuth_deg=azimuth, polar_deg=polar)


def _errors(rows: Sequence[VioRow], estimator: str, kind: str, polar: bool = False) -> list[float]:
    links = [link for row in rows for link in row.links if (link.estimator, link.poses) == (estimator, kind)]
    values = [link.polar_deg if polar else link.azimuth_deg for link in links]
    return [value for value in values if value is not None]


def _against_ate(rows: Sequence[VioRow], estimator: str) -> list[tuple[float, float]]:
    """(ATE [m], |azimuth error| [deg]) of each link with T265 poses that has both."""
    return [
        (row.drift.ate_m, link.azimuth_deg)
        for row in rows
        for link in row.links
        if row.drift is not None
        and link.azimuth_deg is not None
        and (link.estimator, link.poses) == (estimator, str(PoseKind.T265))
    ]


def _summarise(rows: Sequence[VioRow]) -> Summary:
    drifts = [row.drift for row in rows if row.drift is not None]
    findings = []
    if drifts:
        ate, length = np.array([d.ate_m for d in drifts]), np.array([d.length_m for d in drifts])
        findings += [
            Finding(quantity="runs with both trajectories", ours=float(len(drifts)), paper=57.0),
            Finding(
                quantity="mean ATE of the T265, start aligned", ours=float(ate.mean()), paper=_PAPER["ate"], unit="m"
            ),
            Finding(quantity="median ATE", ours=float(np.median(ate)), paper=None, unit="m"),
            Finding(quantity="mean length of path", ours=float(length.mean()), paper=_PAPER["length"], unit="m"),
            Finding(quantity="mean ATE over length", ours=100 * float(np.mean(ate / length)), paper=7.0, unit="%"),
            Finding(
                quantity="mean angular drift in azimuth",
                ours=_mean([d.azimuth_deg for d in drifts]),
                paper="more than in polar",
                unit="deg",
            ),
            Finding(
                quantity="mean angular drift in polar angle",
                ours=_mean([d.polar_deg for d in drifts]),
                paper=None,
                unit="deg",
            ),
        ]
    for estimator in _ESTIMATORS:
        for kind in map(str, _KINDS):
            errors, polar = _errors(rows, estimator, kind), _errors(rows, estimator, kind, polar=True)
            if not errors:
                continue
            head = f"{estimator}, {kind}"
            paper = _PAPER if kind == PoseKind.T265 and estimator == "bartlett" else {}
            count = f"of {len(errors)} links"
            findings.append(
                Finding(
                    quantity=f"{head}: median |phi error| {count}",
                    ours=float(np.median(errors)),
                    paper=paper.get("phi"),
                    unit="deg",
                )
            )
            findings.append(
                Finding(
                    quantity=f"{head}: below 10 deg in azimuth", ours=share_below(errors, 10.0), paper=None, unit="%"
                )
            )
            if polar:
                quantity = f"{head}: median |theta error| of {len(polar)} links"
                findings.append(
                    Finding(quantity=quantity, ours=float(np.median(polar)), paper=paper.get("theta"), unit="deg")
                )
        errors_m = _against_ate(rows, estimator)
        if len(errors_m) > _FEW:
            from scipy.stats import spearmanr  # here: a second of imports for all who only want another study

            rank = float(spearmanr(*np.array(errors_m).T).statistic)
            findings.append(
                Finding(
                    quantity=f"{estimator}, t265: rank correlation of ATE and |phi error|", ours=rank, paper="linear"
                )
            )
    problems = [row.problem for row in rows if row.problem]
    return Summary(findings, [*_NOTES, *problems] if findings else problems)


_NOTES = (
    "The paper's 57 runs are of a flying robot; the recordings here are mostly of a ground robot on short level paths, "
    "so the polar angle is seldom observable and the drift smaller.",
)


def _mean(values: Sequence[float]) -> float:
    return float(np.nanmean(values))


def _draw(rows: Sequence[VioRow], figure: Figure) -> None:
    first, drift, second, third = figure.subplots(1, 4)
    drifts = [row.drift for row in rows if row.drift is not None]
    first.hist([100 * d.ate_m for d in drifts], bins=20, color="0.5")
    first.set(xlabel="ATE of the T265 [cm]", ylabel="runs")
    draw_cdf(
        drift,
        {"azimuth": [d.azimuth_deg for d in drifts], "polar angle": [d.polar_deg for d in drifts]},
        "mean angular drift [deg]",
        None,
    )
    groups = {f"{e}, {k}": _errors(rows, e, str(k)) for e in _ESTIMATORS for k in _KINDS}
    draw_cdf(second, groups, "|azimuth error| [deg]", (0, 60))
    for marker, estimator in zip(MARKERS, _ESTIMATORS, strict=False):
        pairs = _against_ate(rows, estimator)
        third.plot([100 * a for a, _ in pairs], [e for _, e in pairs], marker, fillstyle="none", label=estimator)
    third.set(xlabel="ATE of the T265 [cm]", ylabel="|azimuth error| with it [deg]", ylim=(0, 60))
    third.grid(color="0.92")
    third.legend(fontsize=7)


STUDY = Study(
    name="vio",
    title="Tracking camera against motion capture on real recordings",
    figures=("fig:ATE_trans_error_cameraTraj", "fig:Mocap_vs_camera_AOA_cdf", "fig:Mocap_vs_camera_AOA"),
    default_trials=10_000,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(18.0, 4.4),
)
