"""Every link of a data set against its truth: errors by set, with and without the estimates that call themselves
unreliable."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from companion.analysis.bearings import analyze_run
from companion.analysis.result import NO_LEVER, LinkResult, Options, RunResult
from companion.analysis.runs import Run
from companion.core.messages import Vector3
from wsr.profile import profile_variance

ALL = "all"
UNEVALUATED_DEG = 180.0
"""The error of a link that has its files but gave no estimate: as wrong as can be."""
_WITHIN_DEG = 10.0
_RELIABLE = 0.8
MIN_RANKED = 50
"""Links; of fewer a ranking is chance, and people are shown none."""
_DRAWS = 500
_DRAWN_FROM = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkRow:
    """One link. `error_deg` is |azimuth error| at the estimate's own reference point."""

    set: str
    position: str
    run: str
    tx: str
    error_deg: float
    azimuth_deg: float | None
    true_azimuth_deg: float | None
    polar_deg: float | None
    """From Up; `elevation_deg` is the same above the horizon."""
    true_polar_deg: float | None
    elevation_deg: float | None
    true_elevation_deg: float | None
    azimuth_std_deg: float | None
    reliability: float
    """0 for a link without an estimate."""
    packets: int
    reason: str
    """Why it could not be evaluated; empty where it could."""
    profile_variance: float | None = None
    """The confidence of the WSR Toolbox, lower is better, for comparison with the reliability."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Errors of some links: how many, median, mean, 90th percentile, share under 10 degrees."""

    n: int
    median_deg: float
    mean_deg: float
    p90_deg: float
    within_10: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Trust:
    """What the reliability is worth over all links, and whether the more reliable are the better ones.

    Areas are under the curves of `risk_coverage`, in degrees; intervals hold 95 % of what as many links, drawn from
    these with replacement, give.
    """

    links: int
    reliable: int
    """Links whose reliability is above 0.8."""
    reliable_within_3_std: float | None
    """Share of those whose azimuth error is within 3 of their standard deviations; None if there are none."""
    area_reliability_deg: float
    area_profile_variance_deg: float
    area_difference_deg: tuple[float, float]
    """Interval of the first less the second: of one sign where one ranks better than the other."""
    best_half: Figures
    """The more reliable half of the links."""
    best_half_gain_deg: tuple[float, float]
    """Interval of the mean error of all links less that of this half."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A link or run whose files are not there."""

    set: str
    run: str
    reason: str


@dataclass(frozen=True, slots=True)
class Note:
    """What to know about a run, or one link of it, that was evaluated all the same."""

    set: str
    run: str
    tx: str | None
    text: str


@dataclass(frozen=True, slots=True)
class RunRows:
    """What one run adds to an evaluation."""

    links: list[LinkRow]
    left_out: list[LeftOut]
    notes: list[Note]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """`sets` counts every link that has files; `reliable` only those at or above the reliability asked for."""

    poses: str
    estimator: str
    min_reliability: float
    sets: dict[str, Figures]
    reliable: dict[str, Figures]
    trust: Trust
    links: list[LinkRow]
    left_out: list[LeftOut]
    notes: list[Note]
    lever_m: Vector3 = NO_LEVER
    """Of the antenna from the tracked point, as used."""


def evaluate_run(run: Run, options: Options) -> RunRows:
    """The rows of one run. Pure but for reading its files, so runs can be shared out to processes."""
    return rows_of(run, analyze_run(run, options))


def evaluation(
    runs: Iterable[RunRows], poses: str, estimator: str, min_reliability: float, *, lever_m: Vector3 = NO_LEVER
) -> Evaluation:
    """Of one run or more, with one link or more among them."""
    found = list(runs)
    rows = sorted((row for run in found for row in run.links), key=lambda row: (row.set, row.position, row.run, row.tx))
    reliable = [row for row in rows if row.reliability >= min_reliability]
    return Evaluation(
        poses=poses,
        estimator=estimator,
        min_reliability=min_reliability,
        sets=_by_set(rows),
        reliable=_by_set(reliable),
        trust=trust(rows),
        links=rows,
        left_out=sorted((entry for run in found for entry in run.left_out), key=lambda entry: entry.run),
        notes=sorted((note for run in found for note in run.notes), key=lambda note: (note.set, note.run)),
        lever_m=lever_m,
    )


def trust(links: Sequence[LinkRow]) -> Trust:
    """What the reliability of these links, one at least, is worth."""
    sure = [row for row in links if row.reliability > _RELIABLE and row.azimuth_std_deg is not None]
    within = [row.error_deg <= 3 * (row.azimuth_std_deg or 0.0) for row in sure]
    differences, gains = _drawn(links)
    return Trust(
        links=len(links),
        reliable=len(sure),
        reliable_within_3_std=float(np.mean(within)) if sure else None,
        area_reliability_deg=_area_deg(links),
        area_profile_variance_deg=_area_deg(links, by_profile_variance=True),
        area_difference_deg=_interval(differences),
        best_half=_figures([row.error_deg for row in _best_half(links)]),
        best_half_gain_deg=_interval(gains),
    )


def _drawn(links: Sequence[LinkRow]) -> tuple[list[float], list[float]]:
    """Differences of the areas, and gains of the better half, of as many links drawn anew; the same every time."""
    rng = np.random.default_rng(_DRAWN_FROM)
    differences, gains = [], []
    for _ in range(_DRAWS):
        drawn = [links[number] for number in rng.integers(0, len(links), len(links))]
        differences.append(_area_deg(drawn) - _area_deg(drawn, by_profile_variance=True))
        gains.append(_mean_deg(drawn) - _mean_deg(_best_half(drawn)))
    return differences, gains


def _best_half(links: Sequence[LinkRow]) -> Sequence[LinkRow]:
    return sorted(links, key=lambda row: -row.reliability)[: max(1, len(links) // 2)]


def _mean_deg(links: Sequence[LinkRow]) -> float:
    return float(np.mean([row.error_deg for row in links]))


def _area_deg(links: Sequence[LinkRow], by_profile_variance: bool = False) -> float:
    return float(risk_coverage(links, by_profile_variance)[1].mean())


def _interval(values: Sequence[float]) -> tuple[float, float]:
    low, high = np.percentile(values, (2.5, 97.5)).tolist()
    return low, high


def risk_coverage(links: Sequence[LinkRow], by_profile_variance: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Mean error (N,) [deg] of the most reliable links, or those of the lowest profile variance, against the share (N,)
    of links kept."""
    score = [row.reliability for row in links]
    if by_profile_variance:
        score = [-math.inf if row.profile_variance is None else -row.profile_variance for row in links]
    order = np.argsort([-value for value in score], kind="stable")
    errors = np.array([row.error_deg for row in links])[order]
    kept = np.arange(1, len(errors) + 1)
    return kept / max(len(errors), 1), np.cumsum(errors) / kept


def _by_set(rows: Sequence[LinkRow]) -> dict[str, Figures]:
    names = sorted({row.set for row in rows})
    groups = {name: [row.error_deg for row in rows if row.set == name] for name in names}
    if len(names) > 1:
        groups[ALL] = [row.error_deg for row in rows]
    return {name: _figures(errors) for name, errors in groups.items()}


def _figures(errors_deg: list[float]) -> Figures:
    errors = np.array(errors_deg)
    return Figures(
        n=len(errors),
        median_deg=float(np.median(errors)),
        mean_deg=float(errors.mean()),
        p90_deg=float(np.percentile(errors, 90)),
        within_10=float(np.mean(errors < _WITHIN_DEG)),
    )


def rows_of(run: Run, result: RunResult) -> RunRows:
    """Of what was found in a run.

    A link whose files are all there counts, whatever came of it. That its truth cannot be known is why it cannot be
    evaluated before anything else.
    """
    rows = [_row(run, link, result.truth_problem) for link in result.links]
    if result.failure is not None:
        reason = result.truth_problem or result.failure
        rows = [_unevaluated(run, name, reason) for name in sorted(run.tx)]
    said: list[tuple[str | None, str]] = [
        (None, text) for text in result.problems if not any(text in row.reason for row in rows)
    ]
    said += [(link.name, text) for link in result.links for text in link.notes]
    return RunRows(
        rows,
        [LeftOut(run.set_name, run.stamp, text) for text in result.missing],
        [Note(run.set_name, run.stamp, tx, text) for tx, text in said],
    )


def _row(run: Run, link: LinkResult, truth_problem: str | None) -> LinkRow:
    if link.estimate is None or link.truth is None:
        reason = link.problem if link.estimate is None else truth_problem or link.truth_problem
        return _unevaluated(run, link.name, reason or "no estimate", link.used)
    estimate = link.estimate
    std_deg = math.degrees(estimate.azimuth_std_rad)
    difference_rad = math.remainder(estimate.azimuth_rad - link.truth.azimuth_rad, math.tau)
    polar_deg = math.degrees(estimate.polar_rad) if estimate.polar_observable else None
    true_polar_deg = math.degrees(link.truth.polar_rad)
    return LinkRow(
        set=run.set_name,
        position=run.folder.resolve().name,
        run=run.stamp,
        tx=link.name,
        error_deg=abs(math.degrees(difference_rad)),
        azimuth_deg=math.degrees(estimate.azimuth_rad),
        true_azimuth_deg=math.degrees(link.truth.azimuth_rad),
        polar_deg=polar_deg,
        true_polar_deg=true_polar_deg,
        elevation_deg=None if polar_deg is None else 90.0 - polar_deg,
        true_elevation_deg=90.0 - true_polar_deg,
        azimuth_std_deg=std_deg if math.isfinite(std_deg) else None,
        reliability=estimate.reliability,
        packets=estimate.packets,
        reason="",
        profile_variance=None
        if link.profile is None
        else profile_variance(link.profile, estimate.azimuth_rad, estimate.polar_rad),
    )


def _unevaluated(run: Run, name: str, reason: str, packets: int = 0) -> LinkRow:
    return LinkRow(
        set=run.set_name,
        position=run.folder.resolve().name,
        run=run.stamp,
        tx=name,
        error_deg=UNEVALUATED_DEG,
        azimuth_deg=None,
        true_azimuth_deg=None,
        polar_deg=None,
        true_polar_deg=None,
        elevation_deg=None,
        true_elevation_deg=None,
        azimuth_std_deg=None,
        reliability=0.0,
        packets=packets,
        reason=reason,
    )
