"""`companion radio`: what the card needs from root once."""

from __future__ import annotations

from pathlib import Path

import click

from companion.config.file import load_config
from companion.radio.checks import System
from companion.radio.preparing import steps


@click.command()
@click.option("--config", "config_path", type=click.Path(path_type=Path), required=True, help="Of this robot.")
@click.option("--dry-run", is_flag=True, help="Print what would be done, and do nothing.")
def radio(config_path: Path, dry_run: bool) -> None:
    """As root: put the card into monitor mode on its channel and turn the driver's switches.

    companion-radio.service does this at boot. Its network interfaces go down: the robots' network needs another card.
    """
    config = load_config(config_path)
    if config.csi.source == "unix":
        click.echo("csi.source is unix: there is no card to prepare")
    for step in steps(config, System()):
        click.echo(str(step))
        if not dry_run:
            step.take()
