"""Errors of many variants of `robust` on recorded runs, and their table: shared by the ablation and the
cross-validation. A cell is a set and a source of poses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import Progress

from companion.analysis.bearings import analyze_run_with
from companion.analysis.evaluation import LinkRow, rows_of
from companion.analysis.result import Options
from companion.analysis.runs import Run, find_runs
from companion.analysis.trajectories import PoseKind
from wsr.aoa import Estimator

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
CUT_DEG = 30.0

Array = npt.NDArray[np.float64]
Cell = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RecordedLink:
    """Where a column of errors belongs: `cell` is set and poses, `place` the end of the folder's name, such as L6."""

    cell: str
    place: str
    tx: str
    run: str


@dataclass(frozen=True, slots=True, eq=False)
class Trials:
    """|Azimuth errors| (variants, links) [deg], 180 where there is none; polar_deg likewise, nan where not told."""

    links: list[RecordedLink]
    errors_deg: Array
    polar_deg: Array


def trials(directories: Sequence[Path], estimators: Sequence[Estimator], jobs: int, as_sent: bool = True) -> Trials:
    """Every estimator on every link below `directories`; each run is read once for each source of poses. `as_sent` as
    in `companion.analysis.result.Options`."""
    runs = [run for directory in directories for run in find_runs(directory)]
    tasks = [(run, kind) for run in runs for kind in POSES if kind in run.trajectories]
    links: list[RecordedLink] = []
    columns: list[list[tuple[float, float]]] = []
    with (
        ProcessPoolExecutor(max_workers=jobs) as pool,
        Progress(console=Console(stderr=True), transient=True) as progress,
    ):
        bar = progress.add_task("estimating", total=len(tasks))
        work = partial(_rows, estimators=estimators, as_sent=as_sent)
        futures = {pool.submit(work, run, kind): kind for run, kind in tasks}
        for future in as_completed(futures):
            for same_link in zip(*future.result(), strict=True):
                row = same_link[0]
                links.append(RecordedLink(f"{row.set} {futures[future]}", _place(row.position), row.tx, row.run))
                columns.append([(each.error_deg, _polar_error(each)) for each in same_link])
            progress.advance(bar)
    order = sorted(range(len(links)), key=lambda n: (links[n].cell, links[n].place, links[n].run, links[n].tx))
    table = np.array([columns[n] for n in order])
    return Trials([links[n] for n in order], table[:, :, 0].T, table[:, :, 1].T)


def table(links: Sequence[RecordedLink], rows: Sequence[tuple[str, Array, Array | None]]) -> Iterator[str]:
    """Markdown. A row has a name, errors (links,) and errors of the polar angle (links,), or None for none."""
    spatial = np.array([link.cell not in PUBLISHED and link.cell.endswith(" mocap") for link in links])
    names = [name for name in sorted({link.cell for link in links}) if name in PUBLISHED]
    compared = np.array([link.cell in PUBLISHED for link in links])
    head = ["", *(name.replace("_Set", "") for name in names)]
    head += ["mean", f"mean of errors cut at {CUT_DEG:g}°", "< 10°", "cells that pass"]
    head += ["worst in 3D: azimuth, polar"] if np.any(spatial) else []
    yield f"| {' | '.join(head)} |"
    yield "|---" * len(head) + "|"
    if names:
        published = ["WSR Toolbox, published", *(_text(PUBLISHED[name]) for name in names)]
        yield f"| {' | '.join(published)} |{' |' * (len(head) - len(published))}"
    for name, errors, polar in rows:
        figures = cells(links, errors)
        texts = [name, *(_text(figures[cell]) for cell in names)]
        of = errors[compared]
        texts += [f"{of.mean():.2f}", f"{np.minimum(of, CUT_DEG).mean():.2f}", f"{100 * (of < 10).mean():.0f} %"]
        texts += [f"{len(names) - len({cell for cell, _ in missed(figures)})} of {len(names)}"]
        if np.any(spatial):
            worst = "-" if polar is None or np.all(np.isnan(polar[spatial])) else f"{np.nanmax(polar[spatial]):.1f}"
            texts += [f"{errors[spatial].max():.1f}, {worst}"]
        yield f"| {' | '.join(texts)} |"


def cells(links: Sequence[RecordedLink], errors_deg: Array) -> dict[str, Cell]:
    """Median, mean and share under 10 degrees by cell."""
    names = np.array([link.cell for link in links])
    return {str(name): figures_of(errors_deg[names == name]) for name in sorted(set(names))}


def figures_of(errors_deg: Array) -> Cell:
    return float(np.median(errors_deg)), float(errors_deg.mean()), float((errors_deg < 10).mean())


def missed(figures: Mapping[str, Cell]) -> list[tuple[str, str]]:
    """Cells, and which of their figures are worse than the published ones."""
    worse = []
    for cell, bar in PUBLISHED.items():
        if cell in figures:
            median, mean, share = figures[cell]
            checks = (("median", median > bar[0]), ("mean", mean > bar[1]), ("share", share < bar[2]))
            worse += [(cell, what) for what, is_worse in checks if is_worse]
    return worse


def _rows(run: Run, kind: PoseKind, estimators: Sequence[Estimator], as_sent: bool) -> list[list[LinkRow]]:
    options = Options(kind=kind, as_sent=as_sent)
    return [rows_of(run, result).links for result in analyze_run_with(run, options, estimators)]


def _place(folder: str) -> str:
    """L6 of 0627_2D-multi-link_A_L6; the whole name of other folders."""
    last = folder.rsplit("_", 1)[-1]
    return last if last[:1] == "L" and last[1:].isdigit() else folder


def _polar_error(row: LinkRow) -> float:
    if row.polar_deg is None or row.true_polar_deg is None:
        return float("nan")
    return abs(row.polar_deg - row.true_polar_deg)


def _text(figures: Cell) -> str:
    return f"{figures[0]:.1f} / {figures[1]:.1f} / {100 * figures[2]:.0f}"
