"""`companion study`: what the paper derives or simulates, run again beside its own numbers."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import click
from rich.progress import MofNCompleteColumn, Progress
from rich.table import Table

from companion.commands.output_files import TEXT, check_writable, writing
from companion.commands.terminal import Console, wide_console
from companion.errors import CompanionError
from companion.host.pool import ended_by_signals
from companion.sim.scenes import FLOWN, scene_names
from companion.study.catalogue import MODULES, RENDEZVOUS
from companion.study.catalogue import study as load_study
from companion.study.kept import KeptRows
from companion.study.local import ProcessRunner
from companion.study.report import draw, shown, shown_ours, write_json, write_page
from companion.study.study import Outcome, Settings, Study
from companion.study.trials import RunnerError, TrialError, TrialRunner

ALL = "all"
_SCENES = f"Scenes of rendezvous, with commas between: {', '.join(FLOWN)}.  [default: all]"
_PAGE = "report.html"
_PIPE_COLUMNS = 140
_path = click.Path(path_type=Path)
_TRIALS = (
    "Trials a condition; of rendezvous missions in all, shared out to its scenes in turn, of vio runs, and crb has "
    "nothing random to repeat.  "
    "[default: the study's own]"
)


@click.command()
@click.argument("name", type=click.Choice([*MODULES, ALL]))
@click.option("--trials", type=click.IntRange(min=1), help=_TRIALS)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Same seed, same numbers.")
@click.option("--json", "json_path", type=_path, help="Write findings and rows; of `all` a list.")
@click.option(
    "--out",
    type=_path,
    default=Path("study-out"),
    show_default=True,
    help="Folder for pictures and the page of `all`, and for finished missions of rendezvous: a run that was cut short "
    "goes on from there.",
)
@click.option("--scenes", metavar="NAMES", help=_SCENES)
@click.option(
    "--motion",
    type=click.Choice(["chosen", "fixed"]),
    default="chosen",
    show_default=True,
    help="Of rendezvous: the way to the robot chosen by what it would tell, as the service flies, or by a fixed rule.",
)
@click.option(
    "--truths",
    type=click.Choice(["fixed", "drawn"]),
    default="fixed",
    show_default=True,
    help="Of rendezvous: the robot's distance and the error of North as the scene says, or drawn as a belief expects.",
)
@click.option("--markdown", type=_path, help="Write the table of rendezvous as a page of Markdown.")
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
    scenes: str | None,
    motion: Literal["chosen", "fixed"],
    truths: Literal["fixed", "drawn"],
    markdown: Path | None,
    cluster: str | None,
    jobs: int,
    data: Path,
) -> None:
    """Run the study NAME, or `all` of them, and show our numbers beside the paper's.

    Trials are shared out to processes, here or on a Dask cluster; the numbers depend on the seed alone.
    """
    console = wide_console(_PIPE_COLUMNS)
    # A study may take an hour: what would lose its results is said before.
    check_writable(json_path, out)
    check_writable(markdown, out, TEXT)
    named = _named(scenes)
    if (named or markdown or motion != "chosen" or truths != "fixed") and name not in (RENDEZVOUS, ALL):
        only = "--scenes, --motion, --truths and --markdown are"
        raise click.UsageError(f"{only} for the study {RENDEZVOUS}, not for {name}")
    done = _Done(name=name, out=out, json_path=json_path, markdown=markdown)
    studies = [load_study(each) for each in (MODULES if name == ALL else (name,))]
    with ended_by_signals(), _runner(cluster, jobs) as runner:
        for each in studies:
            count = each.default_trials if trials is None else trials
            settings = Settings(count, data.resolve(), named, motion, truths)
            try:
                specs = each.plan(settings)
            except CompanionError as error:
                if name != ALL:
                    raise
                done.leave_out(each, f"left out: {error}", console)
                continue
            try:
                outcome = _run(each, specs, seed, runner, out=out)
            except (TrialError, RunnerError) as error:
                if name != ALL:
                    raise
                done.failed.append(each.name)
                done.leave_out(each, f"failed: {error}", console)
                if isinstance(error, RunnerError):
                    break
                continue
            _print(outcome, runner, console)
            done.add(each, outcome)
    done.finish(console)


@dataclass(slots=True, kw_only=True)
class _Done:
    """What is there so far. Of `all` the page and the JSON grow with each study, so that nothing is lost half way."""

    name: str
    out: Path
    json_path: Path | None
    markdown: Path | None
    outcomes: list[Outcome] = field(default_factory=list)
    pictures: dict[str, Path] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)

    def leave_out(self, study: Study[Any, Any], why: str, console: Console) -> None:
        console.print(f"{study.name}: {why}", markup=False, highlight=False)
        self.missing[study.name] = why
        self._write()

    def add(self, study: Study[Any, Any], outcome: Outcome) -> None:
        picture = self.out / f"{study.name}.png"
        with writing(picture):
            draw(picture, study, outcome)
        self.outcomes.append(outcome)
        self.pictures[study.name] = picture
        if self.markdown is not None and study.table is not None:
            with writing(self.markdown):
                self.markdown.parent.mkdir(parents=True, exist_ok=True)
                self.markdown.write_text(study.table(outcome), encoding="utf-8")
        self._write()

    def finish(self, console: Console) -> None:
        """Raises CompanionError when a study of `all` failed, or none could be run."""
        if self.outcomes:
            page = [self.out / _PAGE] if self.name == ALL else []
            json_path = [] if self.json_path is None else [self.json_path]
            written = [*self.pictures.values(), *page, *json_path]
            console.print("written: " + ", ".join(map(str, written)), highlight=False)
        if self.failed:
            raise CompanionError("; ".join(f"{name} {self.missing[name]}" for name in self.failed))
        if not self.outcomes:
            raise CompanionError("no study could be run")

    def _write(self) -> None:
        if not self.outcomes:
            return
        if self.name == ALL:
            with writing(self.out / _PAGE):
                write_page(self.out / _PAGE, self.outcomes, self.pictures, self.missing)
        if self.json_path is not None:
            with writing(self.json_path):
                write_json(self.json_path, self.outcomes if self.name == ALL else self.outcomes[0])


def _runner(cluster: str | None, jobs: int) -> Any:
    """A context manager that gives a `TrialRunner`."""
    if cluster is None:
        return nullcontext(ProcessRunner(jobs))
    from companion.study.cluster import DaskRunner

    return DaskRunner(cluster)


def _named(scenes: str | None) -> tuple[str, ...]:
    """Raises ConfigError for one that is unknown."""
    return () if scenes is None else scene_names([name.strip() for name in scenes.split(",")], FLOWN)


def _run(study: Study[Any, Any], specs: Sequence[Any], seed: int, runner: TrialRunner, *, out: Path) -> Outcome:
    start = time.monotonic()
    if study.row is None:
        rows = _rows(study, specs, seed, runner, kept=None)
    else:
        with KeptRows[Any, Any](out, study.name, seed, study.row) as kept:
            rows = _rows(study, specs, seed, runner, kept=kept)
    summary = study.summarise(rows)
    if not summary.findings:
        raise TrialError(f"{study.name}: none of {len(specs)} trials gave a result: {'; '.join(summary.notes)}")
    elapsed_s = time.monotonic() - start
    return Outcome(
        study=study.name,
        title=study.title,
        figures=study.figures,
        seed=seed,
        trials=len(specs),
        elapsed_s=elapsed_s,
        findings=summary.findings,
        notes=summary.notes,
        scenes=summary.scenes,
        rows=rows,
    )


def _rows(
    study: Study[Any, Any], specs: Sequence[Any], seed: int, runner: TrialRunner, *, kept: KeptRows[Any, Any] | None
) -> list[Any]:
    """Of all specifications, in order; those that are kept are not run again."""
    todo = [spec for spec in specs if kept is None or kept.row(spec) is None]
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(study.name, total=len(specs), completed=len(specs) - len(todo))

        def done(first: int, rows: list[Any]) -> None:
            progress.advance(task, len(rows))
            if kept is not None:
                kept.add(todo[first : first + len(rows)], rows)

        rows = runner.run(study.trial, todo, seed, done)
    return rows if kept is None else [kept.row(spec) for spec in specs]


def _print(outcome: Outcome, runner: TrialRunner, console: Console) -> None:
    console.print(_findings_table(outcome))
    for note in outcome.notes:
        console.print(f"  {note}", markup=False, highlight=False)
    console.print(f"  seed {outcome.seed}; {runner.name}", markup=False, highlight=False)


def _findings_table(outcome: Outcome) -> Table:
    """Ours beside the paper's."""
    title = (
        f"{outcome.study}: {outcome.title} (seed {outcome.seed}, {outcome.trials} trials, {outcome.elapsed_s:.1f} s)"
    )
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("quantity")
    for heading in ("ours", "paper"):
        table.add_column(heading, justify="right")
    for finding in outcome.findings:
        table.add_row(finding.quantity, shown_ours(finding), shown(finding.paper, finding.unit))
    return table
