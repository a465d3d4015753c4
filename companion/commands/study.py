"""`companion study`: what the paper derives or simulates, run again beside its own numbers."""

from __future__ import annotations

import os
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from companion.errors import CompanionError
from companion.study.catalogue import MODULES
from companion.study.catalogue import study as load_study
from companion.study.local import ProcessRunner
from companion.study.report import draw, findings_table, write_json, write_page
from companion.study.study import Outcome, Settings, Study
from companion.study.trials import Runner

ALL = "all"
_PIPE_COLUMNS = 140
_path = click.Path(path_type=Path)


@click.command()
@click.argument("name", type=click.Choice([*MODULES, ALL]))
@click.option("--trials", type=click.IntRange(min=1), help="Trials a condition.  [default: the study's own]")
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Same seed, same numbers.")
@click.option("--json", "json_path", type=_path, help="Write findings and rows; of `all` a list.")
@click.option(
    "--out", type=_path, default=Path("study-out"), show_default=True, help="Folder for pictures and the page of `all`."
)
@click.option("--cluster", metavar="ADDRESS", help="Run on Dask: tcp://HOST:PORT of a scheduler, or local:N.")
@click.option(
    "--jobs", type=click.IntRange(min=1), default=lambda: os.cpu_count() or 1, help="Processes.  [default: all cores]"
)
@click.option(
    "--data",
    type=_path,
    default=Path("../shared/data"),
    show_default=True,
    help="Real recordings, for the study `vio` (WSR data set layout).",
)
def study(
    name: str,
    trials: int | None,
    seed: int,
    json_path: Path | None,
    out: Path,
    cluster: str | None,
    jobs: int,
    data: Path,
) -> None:
    """Run the study NAME, or `all` of them, and show our numbers beside the paper's.

    Trials are shared out to processes, here or on a Dask cluster; the numbers depend on the seed alone.
    """
    console = Console()
    if not console.is_terminal:
        console = Console(width=_PIPE_COLUMNS)
    studies = [load_study(each) for each in (MODULES if name == ALL else (name,))]
    outcomes, pictures = [], {}
    with _runner(cluster, jobs) as runner:
        for each in studies:
            try:
                outcome = _run(each, trials, seed, data, runner)
            except CompanionError as error:
                if name != ALL:
                    raise
                console.print(f"{each.name}: left out: {error}", markup=False, highlight=False)
                continue
            _print(outcome, runner, console)
            outcomes.append(outcome)
            pictures[each.name] = out / f"{each.name}.png"
            _written(draw, pictures[each.name], each, outcome)
    if not outcomes:
        raise CompanionError("no study could be run")
    written = list(pictures.values())
    if name == ALL:
        written.append(out / "report.html")
        _written(write_page, written[-1], outcomes, pictures)
    if json_path is not None:
        written.append(json_path)
        _written(write_json, json_path, outcomes if name == ALL else outcomes[0])
    console.print("written: " + ", ".join(map(str, written)), highlight=False)


def _runner(cluster: str | None, jobs: int) -> Any:
    """A context manager that gives a `Runner`."""
    if cluster is None:
        return nullcontext(ProcessRunner(jobs))
    from companion.study.cluster import DaskRunner

    return DaskRunner(cluster)


def _run(study: Study[Any, Any], trials: int | None, seed: int, data: Path, runner: Runner) -> Outcome:
    count = study.default_trials if trials is None else trials
    specs = study.plan(Settings(count, data.resolve()))
    start = time.monotonic()
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(study.name, total=len(specs))
        rows = runner.run(study.trial, specs, seed, lambda done: progress.advance(task, done))
    summary = study.summarise(rows)
    elapsed_s = time.monotonic() - start
    return Outcome(
        study.name, study.title, study.figures, seed, len(specs), elapsed_s, summary.findings, summary.notes, rows
    )


def _print(outcome: Outcome, runner: Runner, console: Console) -> None:
    console.print(findings_table(outcome))
    for note in outcome.notes:
        console.print(f"  {note}", markup=False, highlight=False)
    console.print(f"  seed {outcome.seed}; {runner.name}", markup=False, highlight=False)


def _written(write: Any, path: Path, *arguments: Any) -> None:
    try:
        write(path, *arguments)
    except OSError as error:
        raise CompanionError(f"{error.filename or path}: cannot be written: {error.strerror}") from None
