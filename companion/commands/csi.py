"""`companion csi`: what logs of CSI hold, of whichever card."""

from __future__ import annotations

import json
from pathlib import Path

import click

from companion.analysis.csi_logs import as_json, lines, read_content
from companion.commands.output_files import check_writable, writing
from companion.errors import CompanionError
from companion.host.whole_file import write_whole


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the result here.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for a picture of each log: amplitude over time.")
def csi(files: tuple[Path, ...], json_path: Path | None, out: Path | None) -> None:
    """What the logs FILE hold: format, records, senders, antennas, widths, subcarriers, rate and clocks.

    The content tells what a file is, not its name: logs of the Intel 5300 (headers of 20, 34 and 38 bytes) and of
    FeitCSI (AX200, AX210). Exit code 1 when a file is none, after all others have been read.
    """
    check_writable(json_path, out)
    results: list[dict[str, object]] = []
    refused: list[str] = []
    for file in files:
        try:
            content = read_content(file)
        except CompanionError as error:
            refused.append(str(error))
            click.echo(f"companion: {error}", err=True)
            continue
        click.echo("\n".join(lines(content)))
        results.append(as_json(content))
        if out is not None:
            from companion.pictures.csi import draw_amplitudes

            picture = _picture(out, file, results)
            with writing(picture):
                draw_amplitudes(picture, f"{file.name}: {content.format}", content.picture)
    if json_path is not None:
        with writing(json_path):
            write_whole(json_path, json.dumps(results, indent=2, allow_nan=False) + "\n")
    if refused:
        raise CompanionError(f"{len(refused)} of {len(files)} files could not be read")


def _picture(out: Path, file: Path, results: list[dict[str, object]]) -> Path:
    """Named like the log; of several logs of one name, with a number."""
    same = sum(Path(str(result["file"])).name == file.name for result in results)
    return out / (f"{file.name}.png" if same == 1 else f"{file.name}-{same}.png")
