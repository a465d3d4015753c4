"""Every public recording imported, replayed and reported; its bearings must be those of `companion analyze`.

    python -m tests.faults.every_recording DATA OUT

A long campaign: about a minute on a quiet machine. Exit 1 when a bearing differs or a page is not made.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click

from companion.analysis import Options, analyze_run
from companion.analysis_report import as_json
from companion.errors import CompanionError
from companion.log.recording import analyze_session, import_run, path_of_recording, scene_of
from companion.log_reader import open_session
from companion.recordings import Run, find_runs
from companion.report.page import recording_page
from companion.report.pictures import path_of


@click.command()
@click.argument("data", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
def main(data: Path, out: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    runs = find_runs(data)
    wrong = [problem for run in runs if (problem := _check(run, out))]
    links = "\n".join(wrong)
    click.echo(f"{len(runs) - len(wrong)} of {len(runs)} runs the same\n{links}")
    sys.exit(bool(wrong))


def _check(run: Run, out: Path) -> str:
    """What is wrong with one run, or nothing."""
    log = out / f"{run.set_name}_{run.folder.name}_{run.stamp}.mcap"
    try:
        import_run(run, log, Options())
    except CompanionError as error:
        return f"{run.title}: {error}"
    session = open_session(log)
    replayed, direct = analyze_session(session), analyze_run(run, Options())
    old, new = (as_json([result])["runs"][0]["links"] for result in (direct, replayed))  # type: ignore[index]
    page = recording_page(session, scene_of(session), replayed, path_of(path_of_recording(session, replayed.kind), []))
    log.with_suffix(".html").write_text(page, encoding="utf-8")
    click.echo(f"{run.title}: {len(new)} links, {'same' if old == new else 'DIFFERENT'}")
    return "" if old == new else f"{run.title}: {old} became {new}"


if __name__ == "__main__":
    main()
