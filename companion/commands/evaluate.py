"""`companion evaluate`: bearings of a whole data set against its truth."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path

import click
from rich.progress import Progress

from companion.analysis.evaluation import MIN_RANKED, Evaluation, RunRows, Trust, evaluate_run, evaluation
from companion.analysis.result import DEFAULT_LEVERS_M, NO_LEVER, Options
from companion.analysis.runs import Run, find_runs
from companion.analysis.summary import lever_line
from companion.analysis.trajectories import PoseKind
from companion.commands.numbers import Number
from companion.commands.output_files import check_writable, write_json, writing
from companion.commands.recordings import lever_option
from companion.commands.tables import figures_table
from companion.commands.terminal import Console, bar_columns, wide_console
from companion.core.messages import Vector3
from companion.errors import CompanionError
from companion.host.pool import computed
from wsr.estimators import ESTIMATORS

_PIPE_COLUMNS = 120
_path = click.Path(path_type=Path, readable=False)  # what cannot be read is said by who reads it


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
    type=Number(0, 1),
    default=0.5,
    show_default=True,
    help="The second table leaves out estimates below this.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1, help="Processes.  [default: all cores]"
)
@lever_option
@click.option("--json", "json_path", type=_path, help="Write the result, with a row for each link.")
@click.option("--out", type=_path, help="Folder for the pictures: error CDFs, and error against links kept.")
def evaluate(
    directory: Path,
    poses: str,
    estimator: str,
    min_reliability: float,
    jobs: int,
    lever: Vector3 | None,
    json_path: Path | None,
    out: Path | None,
) -> None:
    """Evaluate every run below DIR (WSR data set layout): errors of the azimuth by set and in all.

    The truth is taken at each estimate's own reference point. T265 and odometry are used in their own start heading,
    never fitted to the truth. A link whose files are there but that gives no estimate, or whose truth is not known,
    counts as 180 degrees off; the reasons are listed.
    """
    console = wide_console(_PIPE_COLUMNS)
    kind = PoseKind(poses)
    runs = find_runs(directory)
    check_writable(json_path, out)
    done = _evaluate_all(runs, Options(kind=kind, lever_m=lever, estimator=estimator), jobs)
    if not any(run.links for run in done):
        left_out = [entry.reason for run in done for entry in run.left_out]
        raise CompanionError(f"{directory}: no link has all its files: {left_out[0]}")
    result = evaluation(
        done, poses, estimator, min_reliability, lever_m=DEFAULT_LEVERS_M[kind] if lever is None else lever
    )
    _print(result, console)
    if json_path is not None:
        write_json(json_path, result)
    if out is not None:
        with writing(out):
            _draw(result, out, console)


def _evaluate_all(runs: list[Run], options: Options, jobs: int) -> list[RunRows]:
    """All runs, shared out to processes. The order in which they end does not show in the result."""
    done: list[RunRows] = []
    with (
        Progress(*bar_columns(), console=Console(stderr=True), transient=True) as progress,
        computed(partial(evaluate_run, options=options), runs, min(jobs, len(runs))) as futures,
    ):
        task = progress.add_task("evaluating", total=len(runs))
        for future in as_completed(futures):
            done.append(future.result())
            progress.advance(task)
    return done


def _print(result: Evaluation, console: Console) -> None:
    console.print(figures_table(f"|azimuth error|, all links ({result.estimator}, {result.poses})", result.sets))
    title = f"reliability {result.min_reliability:g} or more"
    console.print(figures_table(title, result.reliable, of=result.sets))
    console.print(_trust_line(result.trust), highlight=False)
    for line in _said(result):
        console.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)


def _said(result: Evaluation) -> Iterator[str]:
    """Below the tables: what was assumed, what counts as 180 degrees, what does not count, what to know beside it."""
    if result.poses == PoseKind.ODOM and result.lever_m != NO_LEVER:
        yield f"- {lever_line(result.lever_m)}"
    for row in result.links:
        if row.reason:
            yield f"! counted as 180°: {row.set} {row.run} {row.tx}: {row.reason}"
    for entry in result.left_out:
        yield f"- not counted: {entry.set} {entry.run}: {entry.reason}"
    for note in result.notes:
        tx = "" if note.tx is None else f" {note.tx}"
        yield f"- {note.set} {note.run}{tx}: {note.text}"


def _trust_line(trust: Trust) -> str:
    within = "" if trust.reliable_within_3_std is None else f", {trust.reliable_within_3_std:.0%} within 3 deviations"
    text = f"reliability above 0.8: {trust.reliable} of {trust.links} links{within}"
    if trust.links < MIN_RANKED:
        return f"{text}; how it ranks them is left out: {trust.links} links, at least {MIN_RANKED} are needed"
    half, (gain_low, gain_high), (low, high) = trust.best_half, trust.best_half_gain_deg, trust.area_difference_deg
    return (
        f"{text}; more reliable half ({half.n} links): median {half.median_deg:.2f}°, mean {half.mean_deg:.2f}°, "
        f"{gain_low:+.2f} to {gain_high:+.2f}° below that of all {trust.links} (95 %); area under risk and coverage: "
        f"{trust.area_reliability_deg:.2f}° by reliability, {trust.area_profile_variance_deg:.2f}° by "
        f"profile variance (difference {low:+.2f} to {high:+.2f}°)"
    )


def _draw(result: Evaluation, out: Path, console: Console) -> None:
    from companion.pictures.evaluation import draw_error_cdfs, draw_risk_coverage

    out.mkdir(parents=True, exist_ok=True)
    name = f"{result.estimator}_{result.poses}"
    draw_error_cdfs(out / f"error_cdf_{name}.png", result)
    draw_risk_coverage(out / f"risk_coverage_{name}.png", result)
    console.print(f"pictures: {out}", highlight=False)
