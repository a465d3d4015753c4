"""`python -m benchmarks.crossvalidation DIR [DIR...]`: are the numbers of `robust` chosen, or tuned to these runs?

Every choice of a grid around the default is tried on every link, with motion capture and with the T265. Then each
position in turn is held out, or each run, or each transmitter: the choice with the least mean error of the others is
judged by its errors on those held out. The held-out errors together, cell by cell (a set and a source of poses), are
what choosing by these runs is worth on a place never seen; beside them stands each fixed choice over all links.

A bootstrap over places and transmitters, since links of one place and transmitter err alike, says how well the figures
of the default are known at all.
"""

from __future__ import annotations

import itertools
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import Progress

from companion.analysis import Options
from companion.evaluation import LinkRow, evaluate_run_with
from companion.recordings import Run, find_runs
from companion.trajectories import PoseKind
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust

DELAYS_NS: Sequence[float | None] = (5.0, 6.0, 7.0, 8.0, 10.0, 12.0)
SCALES: Sequence[tuple[int, ...]] = ((1, 2, 4), (1, 2, 4, 8))
BINS_WAVELENGTHS: Sequence[float] = (1 / 20, 1 / 13.5, 1 / 9)
POSES = (PoseKind.MOCAP, PoseKind.T265)
PUBLISHED: Mapping[str, tuple[float, float, float]] = {
    "LOS_Set_A mocap": (4.0, 4.0, 0.98),
    "LOS_Set_A t265": (6.2, 7.4, 0.79),
    "LOS_Set_B mocap": (4.1, 5.9, 0.88),
    "LOS_Set_B t265": (4.8, 8.3, 0.74),
    "NLOS_Set_A mocap": (6.8, 19.0, 0.65),
    "NLOS_Set_A t265": (11.8, 20.0, 0.46),
    "NLOS_Set_B mocap": (8.9, 22.0, 0.53),
    "NLOS_Set_B t265": (10.8, 25.0, 0.47),
    "NLOS_Set_C mocap": (3.7, 5.2, 0.90),
    "NLOS_Set_C t265": (6.6, 8.8, 0.69),
}
"""Of the WSR Toolbox over the whole data set, by its own output files: median, mean |azimuth error| [deg], share under
10 degrees. Cells of other sets have nothing to be compared with."""
_BOOTSTRAPS = 2000
_CUT_DEG = 30.0

Array = npt.NDArray[np.float64]


DEFAULT = RobustOptions()


@dataclass(frozen=True, slots=True)
class Choice:
    """One point of the grid."""

    delay_ns: float | None
    scales: tuple[int, ...]
    bin_wavelengths: float

    @property
    def options(self) -> RobustOptions:
        return replace(DEFAULT, delay_ns=self.delay_ns, scales=self.scales, bin_wavelengths=self.bin_wavelengths)

    def __str__(self) -> str:
        bins = f"1/{1 / self.bin_wavelengths:g}"
        return f"{self.delay_ns or 'no':g} ns, scales {'-'.join(map(str, self.scales))}, bins λ{bins[1:]}"


OWN = Choice(DEFAULT.delay_ns, DEFAULT.scales, DEFAULT.bin_wavelengths)


@dataclass(frozen=True, slots=True)
class Link:
    """Where a row of errors belongs: `cell` is set and poses, `place` the end of the folder's name, such as L6."""

    cell: str
    place: str
    tx: str
    run: str


HELD_OUT: Mapping[str, Callable[[Link], str]] = {
    "position": lambda link: link.place,
    "run": lambda link: link.run,
    "transmitter": lambda link: link.tx,
}


@dataclass(frozen=True, slots=True, eq=False)
class Trials:
    """Errors (choices, links) [deg] of every choice on every link; polar_deg likewise, nan where it is not told."""

    choices: list[Choice]
    links: list[Link]
    errors_deg: Array
    polar_deg: Array


@dataclass(frozen=True, slots=True)
class Fold:
    """What was chosen without `held_out`, and its mean error there."""

    held_out: str
    chosen: Choice
    held_out_mean_deg: float


def grid() -> list[Choice]:
    """Every combination; the default is one of them."""
    choices = [Choice(*each) for each in itertools.product(DELAYS_NS, SCALES, BINS_WAVELENGTHS)]
    return choices if OWN in choices else [OWN, *choices]


def errors_of_run(run: Run, kind: PoseKind, choices: Sequence[Choice]) -> list[list[LinkRow]]:
    """Rows of every choice; the run is read once."""
    estimators = [Robust(choice.options) for choice in choices]
    return [rows for rows, _ in evaluate_run_with(run, Options(kind=kind), estimators)]


def trials(directories: Sequence[Path], choices: list[Choice], jobs: int) -> Trials:
    runs = [run for directory in directories for run in find_runs(directory)]
    tasks = [(run, kind) for run in runs for kind in POSES if kind in run.trajectories]
    links: list[Link] = []
    columns: list[list[tuple[float, float]]] = []
    with (
        ProcessPoolExecutor(max_workers=jobs) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        bar = progress.add_task("estimating", total=len(tasks))
        futures = {pool.submit(partial(errors_of_run, run, kind, choices)): kind for run, kind in tasks}
        for future in as_completed(futures):
            for same_link in zip(*future.result(), strict=True):
                row = same_link[0]
                links.append(Link(f"{row.set} {futures[future]}", _place(row.position), row.tx, row.run))
                columns.append([(each.error_deg, _polar_error(each)) for each in same_link])
            progress.advance(bar)
    order = sorted(range(len(links)), key=lambda n: (links[n].cell, links[n].place, links[n].run, links[n].tx))
    table = np.array([columns[n] for n in order])
    return Trials(choices, [links[n] for n in order], table[:, :, 0].T, table[:, :, 1].T)


def folds(done: Trials, key: Callable[[Link], str], cut_deg: float) -> tuple[list[Fold], Array]:
    """Each value of `key` held out in turn, and the held-out errors (links,) of all of them together. In the choice
    errors count up to `cut_deg`. Raises ValueError where `key` has one value only."""
    keys = np.array([key(link) for link in done.links])
    if len(set(keys)) < 2:
        raise ValueError(f"all links are of {keys[0]}")
    counted = np.minimum(done.errors_deg, cut_deg)
    held_out = np.zeros(len(keys))
    found = []
    for value in sorted(set(keys)):
        here = keys == value
        best = int(np.argmin(counted[:, ~here].mean(axis=1)))
        held_out[here] = done.errors_deg[best, here]
        found.append(Fold(str(value), done.choices[best], float(held_out[here].mean())))
    return found, held_out


def cells(links: Sequence[Link], errors_deg: Array) -> dict[str, tuple[float, float, float]]:
    """Median, mean and share under 10 degrees by cell."""
    names = np.array([link.cell for link in links])
    return {name: _figures(errors_deg[names == name]) for name in sorted(set(names))}


def passes(figures: Mapping[str, tuple[float, float, float]]) -> tuple[int, list[str]]:
    """How many cells are no worse than the published ones in all three, and what the others miss."""
    good, missed = 0, []
    for name, bar in PUBLISHED.items():
        if name in figures:
            median, mean, share = figures[name]
            worse = [
                *(["median"] if median > bar[0] else []),
                *(["mean"] if mean > bar[1] else []),
                *(["share"] if share < bar[2] else []),
            ]
            good += not worse
            missed += [f"{name}: {what}" for what in worse]
    return good, missed


def bootstrap(done: Trials, errors_deg: Array, seed: int = 1) -> dict[str, tuple[Array, Array]]:
    """5th and 95th percentiles (3,) of each cell's figures over draws of its pairs of place and transmitter."""
    rng = np.random.default_rng(seed)
    result = {}
    for cell in sorted({link.cell for link in done.links}):
        clusters: dict[tuple[str, str], list[float]] = {}
        for link, error in zip(done.links, errors_deg, strict=True):
            if link.cell == cell:
                clusters.setdefault((link.place, link.tx), []).append(float(error))
        groups = [np.array(group) for group in clusters.values()]
        drawn = rng.integers(0, len(groups), (_BOOTSTRAPS, len(groups)))
        figures = np.array([_figures(np.concatenate([groups[n] for n in draw])) for draw in drawn])
        low, high = np.percentile(figures, [5, 95], axis=0)
        result[cell] = (low, high)
    return result


def _several(done: Trials) -> Iterator[tuple[str, Callable[[Link], str]]]:
    """What can be held out: of which there is more than one."""
    return ((what, key) for what, key in HELD_OUT.items() if len({key(link) for link in done.links}) > 1)


def _figures(errors_deg: Array) -> tuple[float, float, float]:
    return float(np.median(errors_deg)), float(errors_deg.mean()), float((errors_deg < 10).mean())


def _place(folder: str) -> str:
    """L6 of 0627_2D-multi-link_A_L6; the whole name of other folders."""
    last = folder.rsplit("_", 1)[-1]
    return last if last[:1] == "L" and last[1:].isdigit() else folder


def _polar_error(row: LinkRow) -> float:
    if row.elevation_deg is None or row.true_elevation_deg is None:
        return float("nan")
    return abs(row.elevation_deg - row.true_elevation_deg)


def _cell(figures: tuple[float, float, float]) -> str:
    return f"{figures[0]:.1f} / {figures[1]:.1f} / {100 * figures[2]:.0f}"


def report(done: Trials, cut_deg: float) -> Iterator[str]:
    """Markdown."""
    names = sorted({link.cell for link in done.links})
    head = ["", *(name.replace("_Set", "") for name in names), "mean", "cut mean", "cells that pass", "3D, worst"]
    yield f"| {' | '.join(head)} |"
    yield "|---" * len(head) + "|"
    rows: list[tuple[str, Array]] = [(str(choice), done.errors_deg[n]) for n, choice in enumerate(done.choices)]
    rows += [(f"each {what} held out", folds(done, key, cut_deg)[1]) for what, key in _several(done)]
    spatial = np.array([not any(link.cell == name for name in PUBLISHED) for link in done.links])
    mocap = np.array([link.cell.endswith(" mocap") for link in done.links])
    for n, (name, errors) in enumerate(rows):
        figures = cells(done.links, errors)
        good, _ = passes(figures)
        worst = ""
        if np.any(spatial & mocap) and n < len(done.choices):
            at = spatial & mocap
            worst = f"{errors[at].max():.1f} / {np.nanmax(done.polar_deg[n, at], initial=0.0):.1f}"
        mark = "**" if n < len(done.choices) and done.choices[n] == OWN else ""
        texts = [_cell(figures[cell]) for cell in names]
        means = f"{errors.mean():.2f} | {np.minimum(errors, _CUT_DEG).mean():.2f}"
        yield f"| {mark}{name}{mark} | {' | '.join(texts)} | {means} | {good} | {worst} |"


def notes(done: Trials, cut_deg: float) -> Iterator[str]:
    """What was chosen in each fold, what the default misses, and how well its figures are known."""
    for what, key in _several(done):
        found = folds(done, key, cut_deg)[0]
        chosen = Counter(str(fold.chosen) for fold in found)
        counts = "; ".join(f"{choice} in {count}" for choice, count in chosen.most_common())
        worst = max(found, key=lambda fold: fold.held_out_mean_deg)
        yield (
            f"- Each of {len(found)} {what}s held out: chosen {counts}; worst {worst.held_out}, "
            f"{worst.held_out_mean_deg:.2f}° in the mean"
        )
    for n, choice in enumerate(done.choices):
        missed = passes(cells(done.links, done.errors_deg[n]))[1]
        if missed:
            yield f"- {choice} misses {', '.join(missed)}"
    for cell, (low, high) in bootstrap(done, done.errors_deg[done.choices.index(OWN)]).items():
        yield (
            f"- {cell}, default, 90 % of draws: median {low[0]:.1f}-{high[0]:.1f}°, mean {low[1]:.1f}-{high[1]:.1f}°, "
            f"under 10° {100 * low[2]:.0f}-{100 * high[2]:.0f} %"
        )


@click.command()
@click.argument("directories", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1)
@click.option(
    "--cut",
    type=click.FloatRange(min=1.0),
    default=180.0,
    show_default=True,
    help="In the choice errors count up to this [deg].",
)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write every error here.")
def main(directories: tuple[Path, ...], jobs: int, cut: float, json_path: Path | None) -> None:
    """Median / mean |azimuth error| [deg] and the share under 10 degrees [%], of every choice and held out."""
    done = trials(directories, grid(), jobs)
    for line in (*report(done, cut), "", *notes(done, cut)):
        click.echo(line)
    if json_path is not None:
        rows = {str(choice): done.errors_deg[n].tolist() for n, choice in enumerate(done.choices)}
        links = [[link.cell, link.place, link.run, link.tx] for link in done.links]
        json_path.write_text(json.dumps({"links": links, "errors_deg": rows}) + "\n")


if __name__ == "__main__":
    main()
