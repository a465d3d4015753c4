"""`companion run`: the service."""

from __future__ import annotations

import logging
from pathlib import Path

import click

from companion.config.file import load_config


@click.command()
@click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    required=True,
    help="Configuration of this robot (configs/*.yaml).",
)
@click.option("--verbose", is_flag=True, help="Log more.")
def run(config_path: Path, verbose: bool) -> None:
    """Run as the service: role uav or beacon. Starts idle; `companion engage` hands the vehicle over."""
    config = load_config(config_path)
    logging.basicConfig(level=logging.DEBUG if verbose else logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    from companion.app import run_service

    run_service(config)
