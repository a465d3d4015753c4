"""What the missions of `rendezvous` say: figures of each scene, the paper's beside ours, the picture and the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from companion.study.belief import PLACE_DEGREES, share_in_band
from companion.study.chi_square import middle_95
from companion.study.figures import draw_cdf
from companion.study.rendezvous_rows import FALSE_M, FlownIteration, MissionRow
from companion.study.shares import Share
from companion.study.study import Finding, Outcome, Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OUTLIERS: Final = 2
_PAPER_MEAN_DEG: Final = 10.17
_PAPER_SCENE: Final = "occluded"
_ENOUGH: Final = 5
"""Missions that a median over iterations of one number needs, and a mean of one report's errors."""
_LIMIT_S: Final = 240.0
_SHARES: Final = ("success", "false_arrival", "unsaid")
_NUMBERS: Final = (
    "median_time_s",
    "overhead",
    "nees_in_band",
    "nees_mean_in_band",
    "nees_mean",
    "held_90",
    "aoa_mean_deg",
    "aoa_median_deg",
)
_HEAD: Final = (
    "scene", "missions", "success %", "false arrival %", "unsaid %", "into a wall %", "median time s",
    "of straight flight", "NEES in band", "means in band", "mean NEES", "90 % held", "AOA mean °", "AOA median °",
)  # fmt: skip

SceneFigures = dict[str, float | None]


def scene_figures(rows: Sequence[MissionRow]) -> SceneFigures:
    """Of the missions of one scene, one or more. Shares are of 1."""
    figures: SceneFigures = {"missions": len(rows)}
    for name, share in _shares(rows).items():
        figures |= {name: share.value, f"{name}_low": share.low, f"{name}_high": share.high}
    succeeded = [row for row in rows if row.succeeded]
    median_s = _median([row.time_s for row in succeeded])
    straight_s = _median([row.straight_s for row in succeeded])
    paper, circle = _errors(rows, "paper_deg"), _errors(rows, "great_circle_deg")
    return figures | {
        "median_time_s": median_s,
        "straight_time_s": straight_s,
        "overhead": None if median_s is None or straight_s is None else median_s / straight_s,
        **_belief_figures(rows),
        "estimates": len(paper),
        "aoa_mean_deg": _mean(paper),
        "aoa_median_deg": _median(paper),
        "aoa_mean_great_circle_deg": _mean(circle),
        "aoa_median_great_circle_deg": _median(circle),
    }


def _shares(rows: Sequence[MissionRow]) -> dict[str, Share]:
    counts = {
        "success": sum(row.succeeded for row in rows),
        "false_arrival": sum(row.arrived_falsely for row in rows),
        "unsaid": sum(row.kept_silent for row in rows),
        "within_2m": sum(row.reached_s is not None for row in rows),
        "left_room": sum(row.left_room for row in rows),
    }
    return {name: Share(count, len(rows)) for name, count in counts.items()}


def _belief_figures(rows: Sequence[MissionRow]) -> SceneFigures:
    told = [[step.belief for step in row.steps if step.belief is not None] for row in rows]
    reports = [belief for mission in told for belief in mission]
    ranges, directions = [b.range_held for b in reports], [b.direction_held for b in reports]
    low, high = middle_95(PLACE_DEGREES)
    return {
        "reports": len(reports),
        "nees_in_band": _mean([low <= b.nees <= high for b in reports]),
        "nees_mean_in_band": share_in_band([[b.nees for b in mission] for mission in told], min(_ENOUGH, len(rows))),
        "nees_mean": _mean([b.nees for b in reports]),
        "nees_median": _median([b.nees for b in reports]),
        "held_90": _mean([*ranges, *directions]),
        "held_90_range": _mean(ranges),
        "held_90_direction": _mean(directions),
    }


def by_scene(rows: Sequence[MissionRow]) -> dict[str, list[MissionRow]]:
    """In the order in which scenes first come."""
    found: dict[str, list[MissionRow]] = {}
    for row in rows:
        found.setdefault(row.scene, []).append(row)
    return found


def summarise(rows: Sequence[MissionRow]) -> Summary:
    """Every scene by itself, and the paper's mission."""
    scenes = by_scene(rows)
    findings = [finding for name, chosen in scenes.items() for finding in _scene_findings(name, chosen)]
    findings += _paper_findings(rows, scenes.get(_PAPER_SCENE, []))
    notes = [_rank_note(rows), _ends_note(rows), *_NOTES]
    if any(row.draws_truths for row in rows):
        notes.append(_DRAWN_NOTE)
    return Summary(findings, notes, {name: scene_figures(chosen) for name, chosen in scenes.items()})


def _scene_findings(name: str, rows: Sequence[MissionRow]) -> list[Finding]:
    figures = scene_figures(rows)
    says = (
        f"says arrived within 2 m (of {len(rows)})",
        f"says arrived beyond {FALSE_M:g} m",
        "came within 2 m and did not say so",
    )
    shares = _shares(rows)
    findings = [_percent(f"{name}: {words}", shares[key]) for key, words in zip(_SHARES, says, strict=True)]
    findings.append(
        Finding(quantity=f"{name}: median time to that", ours=figures["median_time_s"], paper=None, unit="s")
    )
    findings.append(
        Finding(quantity=f"{name}: against straight flight", ours=figures["overhead"], paper=None, unit="times")
    )
    paper = _PAPER_MEAN_DEG if name == _PAPER_SCENE else None
    findings.append(
        Finding(
            quantity=f"{name}: mean AOA error (paper's measure)", ours=figures["aoa_mean_deg"], paper=paper, unit="deg"
        )
    )
    findings.append(
        Finding(quantity=f"{name}: median AOA error", ours=figures["aoa_median_deg"], paper=None, unit="deg")
    )
    return findings


def _paper_findings(rows: Sequence[MissionRow], papers: Sequence[MissionRow]) -> list[Finding]:
    """The paper's numbers are of the way to within 2 m."""
    findings = []
    if papers:
        findings.append(_percent(f"{_PAPER_SCENE}: comes within 2 m", _shares(papers)["within_2m"], "1 of 1"))
    for name, chosen in ((_PAPER_SCENE, papers), ("all", rows)):
        kept = [error for row in chosen for error in sorted(_approach_errors(row))[:-_OUTLIERS]]
        quantity = f"{name}: mean AOA error on the way (paper's measure), each mission without its {_OUTLIERS} worst"
        findings.append(Finding(quantity=quantity, ours=_mean(kept), paper=_PAPER_MEAN_DEG, unit="deg"))
    for moving, word in ((False, "stands"), (True, "drives")):
        value = _mean([error for row in rows for error in _approach_errors(row, moving)])
        findings.append(
            Finding(
                quantity=f"mean AOA error while the ground robot {word}", ours=value, paper="no difference", unit="deg"
            )
        )
    return findings


def _percent(quantity: str, share: Share, paper: str | None = None) -> Finding:
    return Finding(
        quantity=quantity, ours=100 * share.value, paper=paper, unit="%", interval=(100 * share.low, 100 * share.high)
    )


_NOTES = (
    "Flight, mission, gate, guidance, window, worker and tracker are the service's own code at virtual time; radio, "
    "vehicle and cameras are simulated.",
    "The paper flew one mission: 10.17 deg is the mean of its iterations but two, with displacement from motion "
    "capture; ours come from drifting cameras.",
    "Shares carry their 95 % interval (Wilson); times are of successes, and straight flight knows where the robot is.",
)


_DRAWN_NOTE = (
    "How far away the robot is and what both take for North were drawn, in place of the scene's own: a mean NEES of 3 "
    "is then expected, and AOA errors hold those of North."
)


def _rank_note(rows: Sequence[MissionRow]) -> str:
    steps = [step for row in rows for step in row.approach]
    pairs = [(s.crb_deg, s.great_circle_deg) for s in steps if s.crb_deg is not None and s.great_circle_deg is not None]
    if len(pairs) < 3:
        return "Too few iterations to rank bounds against errors."
    from scipy.stats import spearmanr  # here: a second of imports for all who only want another study

    rank = float(spearmanr(*np.array(pairs).T).statistic)
    return f"Rank correlation of bound and error over {len(pairs)} iterations: {rank:.2f}."


def _ends_note(rows: Sequence[MissionRow]) -> str:
    ends = sorted({row.end for row in rows if row.arrived_m is None})
    if not ends:
        return "Every mission ended as arrived."
    counts = ", ".join(f"{end}: {sum(row.end == end for row in rows)}" for end in ends)
    return f"Missions that did not call themselves arrived, by the state they ended in: {counts}."


def table(outcome: Outcome) -> str:
    """A page for docs/results."""
    drawn = " --truths drawn" if any(row.draws_truths for row in outcome.rows) else ""
    lines = [
        "# Rendezvous by scene",
        "",
        f"Written by `companion study rendezvous --trials {outcome.trials} --seed {outcome.seed}{drawn} "
        "--markdown FILE`; [studies](../studies.md) says what the scenes are and what counts as what. Shares carry "
        "their 95 % interval (Wilson).",
        "",
        "| " + " | ".join(_HEAD) + " |",
        "|---|" + "---:|" * (len(_HEAD) - 1),
    ]
    lines += [_table_row(name, rows) for name, rows in by_scene(outcome.rows).items()]
    lines += ["", *(f"- {note}" for note in outcome.notes)]
    return "\n".join(lines) + "\n"


def _table_row(name: str, rows: Sequence[MissionRow]) -> str:
    figures, shares = scene_figures(rows), _shares(rows)
    numbers = [_number(figures[key]) for key in _NUMBERS]
    cells = [name, str(len(rows)), *(str(shares[key]) for key in (*_SHARES, "left_room")), *numbers]
    return "| " + " | ".join(cells) + " |"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _errors(rows: Sequence[MissionRow], measure: str) -> list[float]:
    errors = [getattr(step, measure) for row in rows for step in row.steps]
    return [error for error in errors if error is not None]


def _approach_errors(row: MissionRow, moving: bool | None = None) -> list[float]:
    return [s.paper_deg for s in row.approach if s.paper_deg is not None and moving in (None, s.beacon_moving)]


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def draw(rows: Sequence[MissionRow], figure: Figure) -> None:
    """The paper's two panels, then errors, times and shares by scene."""
    (first, second, third), (fourth, fifth, last) = figure.subplots(2, 3)
    _draw_by_number(first, rows, "paper_deg", "AOA error (paper's measure) [deg]")
    first.axhline(_PAPER_MEAN_DEG, color="0.5", linestyle="--", label="paper: mean but two")
    first.set_ylim(0, 60)
    first.legend(fontsize=7)
    _draw_by_number(second, rows, "crb_deg", "bound, great circle [deg]")
    second.set_yscale("log")
    scenes = by_scene(rows)
    errors = {name: _errors(chosen, "paper_deg") for name, chosen in scenes.items()}
    draw_cdf(third, errors, "AOA error (paper's) [deg]", (0, 60))
    times = {n: [row.time_s if row.succeeded else math.inf for row in chosen] for n, chosen in scenes.items()}
    draw_cdf(fourth, times, "time to saying so within 2 m [s]", (0, _LIMIT_S))
    _draw_shares(fifth, scenes, ("success",))
    _draw_shares(last, scenes, ("false_arrival", "unsaid"))


def _draw_by_number(axes: Axes, rows: Sequence[MissionRow], measure: str, ylabel: str) -> None:
    points = [(number, getattr(step, measure)) for row in rows for number, step in _numbered(row)]
    known = [(number, value) for number, value in points if value is not None]
    axes.plot([n for n, _ in known], [v for _, v in known], "k.", markersize=2, alpha=0.3)
    medians = []
    for number in range(max((n for n, _ in known), default=-1) + 1):
        values = [value for n, value in known if n == number]
        medians.append(float(np.median(values)) if len(values) >= _ENOUGH else math.nan)
    axes.plot(range(len(medians)), medians, "k-", label="median")
    axes.set(xlabel="SAR iteration", ylabel=ylabel)
    axes.grid(color="0.92")


def _numbered(row: MissionRow) -> list[tuple[int, FlownIteration]]:
    return [(step.number, step) for step in row.approach]


def _draw_shares(axes: Axes, scenes: Mapping[str, Sequence[MissionRow]], names: Sequence[str]) -> None:
    places = np.arange(len(scenes))
    for number, name in enumerate(names):
        shares = [_shares(rows)[name] for rows in scenes.values()]
        values = [share.value for share in shares]
        # Rounding may put the value a hair beyond its interval, which a picture refuses.
        below = [max(0.0, share.value - share.low) for share in shares]
        above = [max(0.0, share.high - share.value) for share in shares]
        axes.errorbar(
            values,
            places + 0.25 * number,
            xerr=[below, above],
            fmt="os"[number],
            color=("k", "0.5")[number],
            capsize=3,
            label=name.replace("_", " "),
        )
    axes.set_yticks(places, list(scenes))
    axes.set(xlim=(-0.02, 1.02), xlabel="share of missions")
    axes.invert_yaxis()
    axes.grid(color="0.92")
    axes.legend(fontsize=7)
