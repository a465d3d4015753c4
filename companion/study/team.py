"""`team`: relative places and headings of a team from mutual bearings, held against the truth; not in the paper.

Robots move about at random on paths of their own poses, which drift, with axes that are off and turn slowly. Each
takes overlapping bearings of all others (`companion.sim.team`), and robot 1 estimates where the others are as the
service does, every two seconds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from numpy.random import SeedSequence

from companion.sim.team import STEP_S, Moment, SeenRobot, TeamWorld, moments
from companion.study.chi_square import middle_95
from companion.study.figures import draw_lines
from companion.study.study import Finding, Settings, Study, Summary
from companion.team.estimate import PERIOD_NS, Relative, Team
from companion.team.records import RawSighting, TeamState

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]

_DEGREES: Final = 4
"""Place and heading of a robot."""
_FROM_S: Final = 10.0
_BASE_NS: Final = 1_000 * PERIOD_NS
_TURNING: Final = math.radians(20.0) / 60.0
THREE, FIVE, TURNING, ONE_EYE, TWICE = (
    "3 robots", "5 robots", "5 robots, one turns", "3 robots, one measures", "3 robots, overlaps counted",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class TeamCase:
    condition: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamReport:
    """One estimate of robot 1. `nees` of all placed robots together, `degrees` of freedom of it."""

    t_s: float
    nees: float
    degrees: int
    placed: int
    place_error_m: float | None
    """Mean over the placed robots, as `heading_error_deg`."""
    heading_error_deg: float | None
    turned_deg: float
    """Of the last robot's axes since the beginning, and by how much they are misjudged."""
    turned_error_deg: float
    update_s: float
    """Of processor time."""


@dataclass(frozen=True, slots=True)
class TeamRow:
    condition: str
    robots: int
    reports: list[TeamReport]


def world_of(condition: str) -> TeamWorld:
    duration_s = 120.0 if condition == TURNING else 90.0
    world = TeamWorld(robots=5 if condition in (FIVE, TURNING) else 3, duration_s=duration_s)
    if condition == TURNING:
        return replace(world, turning_rad_s=_TURNING, turning_from_s=30.0)
    return replace(world, observers=frozenset({0})) if condition == ONE_EYE else world


def reports(world: TeamWorld, rng: np.random.Generator, *, counts_overlaps: bool = False) -> Iterator[TeamReport]:
    """What robot 1 makes of a world, every two seconds."""
    team = Team(1, range(2, world.robots + 1))
    every = round(PERIOD_NS * 1e-9 / STEP_S)
    first: Moment | None = None
    for step, moment in enumerate(moments(world, rng)):
        first = first or moment
        now_ns = _ns(moment.t_s)
        for robot, pose_m in enumerate(moment.poses_m, start=1):
            x, y, z = pose_m.tolist()
            team.add_place(robot, now_ns, (x, y, z), boot=1)
        for seen in moment.told:
            if not seen.is_lost or seen.observer == 0:
                team.add_sighting(_raw(seen, counts_overlaps))
        if step and step % every == 0:
            begun_s = time.process_time()
            state = team.update(now_ns)
            assert state is not None
            yield _report(moment, first, state, team.relative(now_ns), update_s=time.process_time() - begun_s)


def _ns(t_s: float) -> int:
    return _BASE_NS + round(t_s * 1e9)


def _raw(seen: SeenRobot, counts_overlaps: bool) -> RawSighting:
    return RawSighting(
        observer=seen.observer + 1,
        target=seen.target + 1,
        number=seen.number,
        t_ns=_ns(seen.t_s),
        azimuth_rad=seen.azimuth_rad,
        azimuth_std_rad=seen.azimuth_std_rad,
        polar_rad=seen.polar_rad,
        polar_std_rad=seen.polar_std_rad,
        range_m=seen.range_m,
        range_std_m=seen.range_std_m,
        reliability=seen.reliability,
        fresh=1.0 if counts_overlaps else seen.fresh,
        boot=1,
    )


def _report(moment: Moment, first: Moment, state: TeamState, told: Relative, *, update_s: float) -> TeamReport:
    error = told.state - true_relative(moment)
    error[:, 3] = (error[:, 3] + math.pi) % math.tau - math.pi
    placed = [n for n, member in enumerate(state.members) if member.placed]
    at = np.concatenate([np.arange(4 * n, 4 * n + 4) for n in placed]) if placed else np.zeros(0, np.intp)
    off = error.ravel()[at]
    return TeamReport(
        t_s=moment.t_s,
        nees=float(off @ np.linalg.solve(told.covariance[np.ix_(at, at)], off)) if placed else 0.0,
        degrees=len(at),
        placed=len(placed),
        place_error_m=float(np.linalg.norm(error[placed, :3], axis=1).mean()) if placed else None,
        heading_error_deg=math.degrees(float(np.abs(error[placed, 3]).mean())) if placed else None,
        turned_deg=math.degrees(moment.headings_rad[-1] - first.headings_rad[-1]),
        turned_error_deg=math.degrees(float(error[-1, 3])),
        update_s=update_s,
    )


def true_relative(moment: Moment) -> Array:
    """(N - 1, 4): places in the first robot's own axes, headings against its own."""
    heading = moment.headings_rad[0]
    cos, sin = math.cos(heading), math.sin(heading)
    x, y, z = (moment.places_m[1:] - moment.places_m[0]).T
    return np.stack([cos * x + sin * y, cos * y - sin * x, z, moment.headings_rad[1:] - heading], axis=1)


def _plan(settings: Settings) -> list[TeamCase]:
    return [TeamCase(condition) for condition in (THREE, FIVE, TURNING, ONE_EYE, TWICE) for _ in range(settings.trials)]


def _trial(case: TeamCase, seed: SeedSequence) -> TeamRow:
    world = world_of(case.condition)
    rng = np.random.default_rng(seed)
    found = list(reports(world, rng, counts_overlaps=case.condition == TWICE))
    return TeamRow(case.condition, world.robots, found)


@dataclass(frozen=True, slots=True)
class Band:
    """Of the trials of one condition: at each report the NEES for each degree of freedom and its 95 % band."""

    t_s: list[float]
    nees: list[float]
    low: list[float]
    high: list[float]

    @property
    def share(self) -> float:
        inside = [low <= nees <= high for nees, low, high in zip(self.nees, self.low, self.high, strict=True)]
        return float(np.mean(inside)) if inside else math.nan


def band(rows: Sequence[TeamRow]) -> Band:
    """From ten seconds on, once half the robots of all trials are placed. Robots of one trial err together, so all of
    one trial's is one value with the degrees of all (Bar-Shalom, Li and Kirubarajan, Estimation, 5.4.2)."""
    found = Band([], [], [], [])
    for at in zip(*(row.reports for row in rows), strict=True):
        degrees = sum(one.degrees for one in at)
        most = sum(_DEGREES * (row.robots - 1) for row in rows)
        if at[0].t_s >= _FROM_S and degrees >= 0.5 * most:
            low, high = middle_95(degrees) / degrees
            found.t_s.append(at[0].t_s)
            found.nees.append(sum(one.nees for one in at) / degrees)
            found.low.append(float(low))
            found.high.append(float(high))
    return found


def _summarise(rows: Sequence[TeamRow]) -> Summary:
    findings = []
    for condition, group in _groups(rows).items():
        found = band(group)
        late = [one for row in group for one in row.reports if one.t_s >= 30.0]
        whole = [one for row in group for one in row.reports if one.t_s >= _FROM_S]
        degrees = max(1, sum(one.degrees for one in whole))
        places = [one.place_error_m for one in late if one.place_error_m is not None]
        headings = [one.heading_error_deg for one in late if one.heading_error_deg is not None]
        findings += [
            Finding(quantity=f"{condition}: reports whose mean NEES is in its 95 % band", ours=found.share),
            Finding(
                quantity=f"{condition}: NEES for each degree of freedom, from 10 s",
                ours=sum(one.nees for one in whole) / degrees,
            ),
            Finding(quantity=f"{condition}: robots placed, from 30 s", ours=_share(late, group[0].robots - 1)),
            Finding(quantity=f"{condition}: place, median error", ours=_median(places), unit="m"),
            Finding(quantity=f"{condition}: axes, median error", ours=_median(headings), unit="deg"),
            Finding(
                quantity=f"{condition}: one update, median",
                ours=1e3 * (_median([o.update_s for o in late]) or 0.0),
                unit="ms",
            ),
        ]
        if condition == TURNING:
            last = [row.reports[-1] for row in group]
            findings += [
                Finding(
                    quantity="one turns: by its poses alone, median",
                    ours=_median([abs(one.turned_deg) for one in last]),
                    unit="deg",
                ),
                Finding(
                    quantity="one turns: by the team, median",
                    ours=_median([abs(o.turned_error_deg) for o in last]),
                    unit="deg",
                ),
            ]
    return Summary(findings, ["the paper has no such study; bearings err as the tracker takes them to (docs/team.md)"])


def _share(late: Sequence[TeamReport], others: int) -> float:
    return float(np.mean([one.placed for one in late]) / others) if late else math.nan


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def _groups(rows: Sequence[TeamRow]) -> dict[str, list[TeamRow]]:
    groups: dict[str, list[TeamRow]] = {}
    for row in rows:
        groups.setdefault(row.condition, []).append(row)
    return groups


def _draw(rows: Sequence[TeamRow], figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    groups = _groups(rows)
    for condition, group in groups.items():
        found = band(group)
        if condition in (THREE, FIVE):
            left.fill_between(found.t_s, found.low, found.high, color="0.85", label=f"{condition}: 95 % band")
        draw_lines(left, found.t_s, {condition: found.nees}, "time [s]", ylabel="NEES / degrees of freedom")
    left.set_yscale("log")
    turning = groups.get(TURNING)
    if turning:
        t_s = [one.t_s for one in turning[0].reports]
        lines = {
            "turned, by its own poses": [_at(turning, k, "turned_deg") for k in range(len(t_s))],
            "misjudged by the team": [_at(turning, k, "turned_error_deg") for k in range(len(t_s))],
        }
        draw_lines(right, t_s, lines, "time [s]", ylabel="axes of one robot, median of absolute values [°]")


def _at(rows: Sequence[TeamRow], index: int, name: str) -> float:
    return float(np.median([abs(getattr(row.reports[index], name)) for row in rows]))


STUDY: Final = Study(
    name="team",
    title="places and axes of a team from mutual bearings",
    figures=("none",),
    default_trials=20,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
)
