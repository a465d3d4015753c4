"""`companion analyze`: bearings from recorded runs."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

import click
from rich.progress import Progress

from companion.analysis.bearings import analyze_run
from companion.analysis.result import LinkResult, Options, RunResult
from companion.analysis.runs import KNOWN_TRANSMITTERS, RecordingError, Run, find_runs, loose_run
from companion.analysis.tables import as_json, note_lines, problem_lines, run_table, summarise, summary_table
from companion.analysis.trajectories import PoseKind
from companion.commands.output_files import check_writable, writing
from companion.commands.terminal import Console, bar_columns
from companion.core.messages import Vector3
from companion.errors import CompanionError
from wsr.estimators import ESTIMATORS

_PIPE_COLUMNS = 150
_PATIENCE_S = 1.0

_file = click.Path(path_type=Path)

Chosen = tuple[Run, dict[str, str]]
"""A run, and the MACs given for it by transmitter name."""


@click.command()
@click.argument("runs", nargs=-1, metavar="[RUN]...", type=_file)
@click.option("--run", "stamps", multiple=True, metavar="TS", help="Only the runs of this time stamp.")
@click.option("--rx", type=_file, help="CSI log of the receiving robot (loose files).")
@click.option("--tx", type=_file, multiple=True, help="CSI log of a transmitter (loose files).")
@click.option("--traj", type=_file, help="Trajectory CSV of the receiving robot (loose files).")
@click.option(
    "--channel",
    type=click.IntRange(36, 177),
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
@click.option(
    "--lever",
    type=(float, float, float),
    metavar="F L U",
    help="Antenna seen from the tracked point, in metres forward, left, up; else that of the WSR robot.",
)
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
    json_path: Path | None,
    out: Path,
    no_pictures: bool,
) -> None:
    """Bearings from recorded CSI of both ends and a trajectory.

    RUN is a folder of recorded runs or one above several: all runs below it are analysed. Or give loose files with
    --rx, --tx and --traj. Prints azimuth (counter-clockwise from East) and polar angle (from Up, 90 is level; where the
    path can tell it) of each transmitter and writes a picture of each profile. Exit code 1 when no bearing was found.
    """
    kind = PoseKind(poses) if poses else None
    if lever is not None and not all(map(math.isfinite, lever)):
        raise click.UsageError(f"--lever {' '.join(map(str, lever))}: expected three finite lengths in metres")
    chosen = [(run, macs_by_name(macs, run)) for run in chosen_runs(runs, stamps, rx, tx, traj, kind)]
    check_writable(json_path, None if no_pictures else out)
    console = Console()
    if not console.is_terminal:
        console = Console(width=_PIPE_COLUMNS)
    results: list[RunResult] = []
    for run, names in _tracked(chosen):
        result = analyze_run(run, Options(kind, channel, names, lever, estimator))
        if not no_pictures:
            draw(result, out)
        results.append(result)
    _report(results, console)
    if json_path is not None:
        with writing(json_path):
            json_path.write_text(json.dumps(as_json(results), indent=2, allow_nan=False) + "\n")
    _check(results)


def chosen_runs(
    folders: tuple[Path, ...],
    stamps: tuple[str, ...],
    rx: Path | None,
    tx: tuple[Path, ...],
    traj: Path | None,
    kind: PoseKind | None,
) -> list[Run]:
    if rx is None and not tx and traj is None:
        if not folders:
            raise click.UsageError("give a RUN folder, or loose files with --rx, --tx and --traj")
        found = list({(run.folder, run.stamp): run for folder in folders for run in find_runs(folder)}.values())
        chosen = [run for run in found if not stamps or run.stamp in stamps]
        missing = sorted(set(stamps) - {run.stamp for run in found})
        if missing:
            listed = ", ".join(sorted({run.stamp for run in found})[:10])
            raise RecordingError(f"no run {', '.join(missing)} in {', '.join(map(str, folders))}; there are: {listed}")
        return chosen
    if folders or stamps:
        raise click.UsageError("--rx, --tx and --traj do not go together with RUN folders and --run")
    if rx is None or not tx or traj is None:
        raise click.UsageError("loose files need all of --rx, --tx and --traj")
    return [loose_run(rx, tx, traj, kind)]


def macs_by_name(macs: tuple[str, ...], run: Run) -> dict[str, str]:
    """MAC by transmitter name. Raises UsageError for a MAC that cannot be told to belong to a file, or not to it."""
    names: dict[str, str] = {}
    unnamed = [name for name in run.tx if not any(given.startswith(f"{name}=") for given in macs)]
    for given in macs:
        name, _, mac = given.rpartition("=")
        mac = mac.upper().replace("-", ":")
        if len(mac.split(":")) != 6 or any(len(byte) != 2 or not _is_hex(byte) for byte in mac.split(":")):
            raise click.UsageError(f"--mac {given}: expected six bytes such as 00:21:6A:3F:17:5A, or NAME=MAC")
        if not name:
            name = KNOWN_TRANSMITTERS.get(mac, "")
            # A file of another known card stays what it is.
            if name not in run.tx and len(unnamed) == 1 and not (name and unnamed[0] in KNOWN_TRANSMITTERS.values()):
                name = unnamed[0]
            if not name:
                raise click.UsageError(f"--mac {mac}: whose? Write NAME={mac} with NAME one of {', '.join(run.tx)}")
        owner = KNOWN_TRANSMITTERS.get(mac)
        if owner not in (None, name) and name in KNOWN_TRANSMITTERS.values():
            raise click.UsageError(f"--mac {given}: {mac} is the card of {owner}, not of {name}")
        if name in names:
            raise click.UsageError(f"--mac {given}: {name} has already been given {names[name]}")
        names[name] = mac
    return names


def _is_hex(byte: str) -> bool:
    return all(digit in "0123456789ABCDEF" for digit in byte)


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


def draw(result: RunResult, out: Path) -> None:
    # Imported late: it takes half a second, and --no-pictures does without.
    from companion.pictures.profile import draw_profile

    for link in result.links:
        if link.estimate is None or link.profile is None:
            continue
        run, truth = result.run, link.truth
        path = out / f"{run.set_name}_{run.stamp}_{link.name}_{result.kind}.png"
        bearing = (truth.azimuth_rad, truth.polar_rad) if truth else None
        seen = {"azimuth": link.estimate.azimuth_observable, "polar angle": link.estimate.polar_observable}
        unseen = " and ".join(name for name, is_seen in seen.items() if not is_seen)
        flat = f"  {unseen} not observable on this path" if unseen else ""
        title = f"{run.title}  {link.name}  ({result.kind}){flat}"
        with writing(path):
            draw_profile(path, link.profile, link.estimate, bearing, title, *seen.values())


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
