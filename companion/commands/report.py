"""`companion report`: a log as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from companion.analysis.trajectories import PoseKind
from companion.commands.output_files import PAGE, check_writable, write_json, writing
from companion.commands.progress import tracked_bytes, working
from companion.host.whole_file import write_whole
from companion.log.reader import Session, open_session, understood

_file = click.Path(path_type=Path)


@click.command()
@click.argument("path", metavar="LOG", type=_file)
@click.option("-o", "--out", type=_file, default=Path("report.html"), show_default=True, help="The page.")
@click.option("--poses", type=click.Choice([kind.value for kind in PoseKind]), help="Trajectory of a recording.")
@click.option("--json", "json_path", type=_file, help="Write its numbers here.")
def report(path: Path, out: Path, poses: str | None, json_path: Path | None) -> None:
    """A flight, or an imported recording, as one self-contained HTML page.

    Truth is taken from the log, or from truth.mcap beside it.
    """
    session = open_session(path)
    check_writable(out, kind=PAGE)
    check_writable(json_path)
    with understood(path):
        if session.metadata.get("role") == "recording":
            page, numbers = _recording(session, PoseKind(poses) if poses else None)
        else:
            page, numbers = _flight(session)
    with writing(out):
        write_whole(out, page)
    if json_path is not None:
        write_json(json_path, numbers)
    click.echo(f"written: {out} ({len(page) / 1e6:.1f} MB)")


def _flight(session: Session) -> tuple[str, dict[str, Any]]:
    from companion.report.content import gather
    from companion.report.page import figures, flight_page

    with tracked_bytes("reading") as progress:
        content = gather(session, progress)
    with working("drawing"):
        return flight_page(content), figures(content)


def _recording(session: Session, kind: PoseKind | None) -> tuple[str, dict[str, Any]]:
    from companion.analysis.imported import analyze_session, path_of_recording, scene_of
    from companion.analysis.summary import as_json
    from companion.report.page import recording_page
    from companion.report.pictures import path_of

    with working("estimating"):
        result = analyze_session(session, kind)
    bearings = [
        (link.name, link.estimate.azimuth_rad)
        for link in result.links
        if link.estimate is not None and link.estimate.azimuth_observable
    ]
    picture = path_of(path_of_recording(session, result.kind), bearings)
    return recording_page(session, scene_of(session), result, picture), as_json([result])
