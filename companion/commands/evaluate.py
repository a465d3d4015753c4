"""`companion evaluate`: bearings of a whole data set against its truth."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path

import click
import msgspec
from rich.console import Console
from rich.progress import Progress

from companion.analysis import Options
from companion.errors import CompanionError
from companion.evaluation import Evaluation, LeftOut, LinkRow, Trust, evaluate_run, evaluation
from companion.evaluation_report import figures_table
from companion.recordings import Run, find_runs
from companion.trajectories import PoseKind
from wsr.estimators import ESTIMATORS

_PIPE_COLUMNS = 120
_path = click.Path(path_type=Path)


@click.command()
@click.argument("directory", metavar="DIR", type=_path)
@click.option(
    "--poses",
    type=click.Choice([kind.value for kind in PoseKind]),
    default=PoseKind.MOCAP.value,
    show_default=True,
    help="Which trajectory of the receiving robot.",
)
@click.option(
    "--estimator",
    type=click.Choice(list(ESTIMATORS)),
    default="robust",
    show_default=True,
    help="How bearings are made.",
)
@click.option(
    "--min-reliability",
    type=click.FloatRange(0, 1),
    default=0.5,
    show_default=True,
    help="The second table leaves out estimates below this.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1, help="Processes.  [default: all cores]"
)
@click.option("--json", "json_path", type=_path, help="Write the result, with a row for each link.")
@click.option("--out", type=_path, help="Folder for the pictures: error CDFs, and error against links kept.")
def evaluate(
    directory: Path,
    poses: str,
    estimator: str,
    min_reliability: float,
    jobs: int,
    json_path: Path | None,
    out: Path | None,
) -> None:
    """Evaluate every run below DIR (WSR data set layout): errors of the azimuth by set and in all.

    The truth is taken at each estimate's own reference point. T265 and odometry are used in their own start heading,
    never fitted to the truth. A link whose files are there but that gives no estimate counts as 180 degrees off.
    """
    console = Console()
    if not console.is_terminal:
        console = Console(width=_PIPE_COLUMNS)
    options = Options(kind=PoseKind(poses), estimator=estimator)
    rows, left_out = _evaluate_all(find_runs(directory), options, jobs)
    if not rows:
        raise CompanionError(
            f"{directory}: no link could be evaluated: {left_out[0].reason if left_out else 'no runs'}"
        )
    result = evaluation(rows, left_out, poses, estimator, min_reliability)
    _print(result, console)
    try:
        if json_path is not None:
            json_path.write_bytes(msgspec.json.format(msgspec.json.encode(result), indent=2))
        if out is not None:
            _draw(result, out, console)
    except OSError as error:
        raise CompanionError(f"{error.filename}: cannot be written: {error.strerror}") from None


def _evaluate_all(runs: list[Run], options: Options, jobs: int) -> tuple[list[LinkRow], list[LeftOut]]:
    """All runs, shared out to processes. The order in which they end does not show in the result."""
    rows: list[LinkRow] = []
    left_out: list[LeftOut] = []
    with (
        Progress(console=Console(stderr=True), transient=True) as progress,
        ProcessPoolExecutor(max_workers=min(jobs, len(runs))) as pool,
    ):
        task = progress.add_task("evaluating", total=len(runs))
        for future in as_completed([pool.submit(partial(evaluate_run, run, options)) for run in runs]):
            run_rows, run_left_out = future.result()
            rows += run_rows
            left_out += run_left_out
            progress.advance(task)
    return rows, left_out


def _print(result: Evaluation, console: Console) -> None:
    console.print(figures_table(f"|azimuth error|, all links ({result.estimator}, {result.poses})", result.sets))
    title = f"reliability {result.min_reliability:g} or more"
    console.print(figures_table(title, result.reliable, of=result.sets))
    console.print(_trust_line(result.trust), highlight=False)
    for row in result.links:
        if row.reason:
            console.print(f"  ! {row.set} {row.run} {row.tx}: {row.reason}", markup=False, highlight=False)
    for entry in result.left_out:
        console.print(f"  - not counted: {entry.set} {entry.run}: {entry.reason}", markup=False, highlight=False)


def _trust_line(trust: Trust) -> str:
    within = "" if trust.reliable_within_3_std is None else f", {trust.reliable_within_3_std:.0%} within 3 deviations"
    return (
        f"reliability above 0.8: {trust.reliable} links{within}; more reliable half: median "
        f"{trust.best_half.median_deg:.2f}°, mean {trust.best_half.mean_deg:.2f}°; area under risk and coverage: "
        f"{trust.area_reliability_deg:.2f}° by reliability, {trust.area_profile_variance_deg:.2f}° by profile variance"
    )


def _draw(result: Evaluation, out: Path, console: Console) -> None:
    from companion.evaluation_plots import draw_error_cdfs, draw_risk_coverage

    out.mkdir(parents=True, exist_ok=True)
    name = f"{result.estimator}_{result.poses}"
    draw_error_cdfs(out / f"error_cdf_{name}.png", result)
    draw_risk_coverage(out / f"risk_coverage_{name}.png", result)
    console.print(f"pictures: {out}", highlight=False)
