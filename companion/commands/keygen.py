"""`companion keygen`: secret keys for the neighbours' datagrams."""

from __future__ import annotations

from pathlib import Path

import click

from companion.neighbours.keys import write_key


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
@click.option("--owner", help="The user whom the key is to belong to, where root makes it.")
def keygen(files: tuple[Path, ...], owner: str | None) -> None:
    """Write a new random key to each FILE, readable by its owner only.

    One key for each robot that sends; every robot that hears it needs a copy. An existing file is never replaced.
    """
    for path in files:
        write_key(path, owner)
        click.echo(f"{path}: new key")
