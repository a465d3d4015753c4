"""`companion analyze`: bearings from recorded runs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
from rich.progress import Progress

from companion.analysis.bearings import analyze_run
from companion.analysis.result import LinkResult, Options, RunResult
from companion.analysis.runs import Run
from companion.analysis.summary import as_json, note_lines, problem_lines, summarise
from companion.analysis.trajectories import PoseKind
from companion.commands.channel_option import known_channel
from companion.commands.moving_ends import moving_ends, with_moving_ends
from companion.commands.output_files import check_writable, write_json
from companion.commands.recordings import chosen_runs, draw_profiles, lever_option, macs_by_name, run_options
from companion.commands.tables import run_table, summary_table
from companion.commands.terminal import Console, bar_columns, wide_console
from companion.core.messages import Vector3
from companion.errors import CompanionError
from wsr.estimators import ESTIMATORS

_PIPE_COLUMNS = 150
_PATIENCE_S = 1.0

_file = click.Path(path_type=Path, readable=False)  # what cannot be read is said by who reads it

Chosen = tuple[Run, dict[str, str]]
"""A run, and the MACs given for it by transmitter name."""


@click.command()
@click.argument("runs", nargs=-1, metavar="[RUN]...", type=_file)
@run_options
@click.option(
    "--channel",
    type=int,
    callback=known_channel,
    help="5 GHz WiFi channel; else as the truth file says.",
)
@click.option(
    "--mac",
    "macs",
    multiple=True,
    metavar="[NAME=]MAC",
    help="Only this transmitter. NAME is that in the file name; needed for cards that are not of the WSR data sets.",
)
@click.option(
    "--poses",
    type=click.Choice([kind.value for kind in PoseKind]),
    help="Which trajectory; else the first there is, in this order.",
)
@click.option(
    "--estimator", type=click.Choice(list(ESTIMATORS)), default="robust", show_default=True, help="How it is estimated."
)
@lever_option
@moving_ends
@click.option("--json", "json_path", type=_file, help="Write the result here.")
@click.option("--out", type=_file, default=Path("analysis"), show_default=True, help="Folder for the pictures.")
@click.option("--no-pictures", is_flag=True, help="Numbers only.")
def analyze(
    runs: tuple[Path, ...],
    stamps: tuple[str, ...],
    rx: Path | None,
    tx: tuple[Path, ...],
    traj: Path | None,
    channel: int | None,
    macs: tuple[str, ...],
    poses: str | None,
    estimator: str,
    lever: Vector3 | None,
    time_offset: float,
    tx_traj: tuple[str, ...],
    tx_time_offset: tuple[str, ...],
    tx_lever: tuple[str, ...],
    json_path: Path | None,
    out: Path,
    no_pictures: bool,
) -> None:
    """Bearings from recorded CSI of both ends and a trajectory.

    RUN is a folder of recorded runs or one above several: all runs below it are analysed. Or give loose files with
    --rx, --tx and --traj. Prints azimuth (counter-clockwise from East) and elevation (above the horizon; where the
    path can tell it) of each transmitter and writes a picture of each profile. Exit code 1 when no bearing was found.
    """
    kind = PoseKind(poses) if poses else None
    found = chosen_runs(runs, stamps, rx, tx, traj=traj, kind=kind)
    options = Options(kind=kind, channel=channel, lever_m=lever, estimator=estimator)
    found, options = with_moving_ends(
        found, options, time_offset, tx_traj, tx_time_offset=tx_time_offset, tx_lever=tx_lever
    )
    chosen = [(run, macs_by_name(macs, run)) for run in found]
    check_writable(json_path, None if no_pictures else out)
    console = wide_console(_PIPE_COLUMNS)
    results: list[RunResult] = []
    for run, names in _tracked(chosen):
        result = analyze_run(run, replace(options, macs=names))
        if not no_pictures:
            draw_profiles(result, out)
        results.append(result)
    _report(results, console)
    if json_path is not None:
        write_json(json_path, as_json(results))
    _check(results)


def _tracked(runs: list[Chosen]) -> Iterator[Chosen]:
    """The runs, with a progress bar on a terminal as soon as it has taken longer than a second."""
    progress = Progress(*bar_columns(), console=Console(stderr=True), transient=True)
    task = progress.add_task("analysing", total=len(runs))
    start = time.monotonic()
    try:
        for number, run in enumerate(runs):
            progress.update(task, completed=number, description=f"analysing {run[0].stamp}")
            if time.monotonic() - start > _PATIENCE_S and progress.console.is_terminal:
                progress.start()
            yield run
    finally:
        # Stopping one that never started prints an empty line.
        if progress.live.is_started:
            progress.stop()


def _report(results: list[RunResult], console: Console) -> None:
    for result in results:
        if any(_succeeded(link) for link in result.links):
            console.print(run_table(result))
            for line in note_lines(result):
                console.print(f"  - {line}", markup=False, highlight=False, soft_wrap=True)
            for line in problem_lines(result):
                console.print(f"  ! {line}", markup=False, highlight=False, soft_wrap=True)
    summaries = summarise(results)
    if len(results) > 1 and summaries:
        console.print(summary_table(summaries))


def _check(results: list[RunResult]) -> None:
    """Runs that gave nothing are named on stderr; CompanionError when no run gave anything."""
    failed = [result for result in results if not any(map(_succeeded, result.links))]
    lines = [(result.run, line) for result in failed for line in problem_lines(result)]
    if len(failed) == len(results) and len(lines) == 1:
        raise CompanionError(lines[0][1])
    for run, line in lines:
        click.echo(f"companion: run {run.stamp}: {line}", err=True)
    if len(failed) == len(results):
        raise CompanionError("nothing could be analysed")
    estimates = [link.estimate for result in results for link in result.links if link.estimate is not None]
    if not any(estimate.azimuth_observable for estimate in estimates):
        raise CompanionError("no bearing: no path lets an azimuth be told (see above)")


def _succeeded(link: LinkResult) -> bool:
    return link.estimate is not None
