"""`companion engage | abort | status`: commands to a running service over its control socket."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import click

from companion.control import ask
from companion.errors import CompanionError

_socket_option = click.option(
    "--socket",
    "socket_path",
    type=click.Path(path_type=Path),
    default=Path("/run/companion/control.sock"),
    show_default=True,
    help="Control socket of the service.",
)


def _ask(path: Path, command: str) -> dict[str, Any]:
    answer = asyncio.run(ask(path, command))
    if not answer.get("ok"):
        raise CompanionError(f"{command} refused: {answer.get('error', 'no reason given')}")
    return answer


@click.command()
@_socket_option
def engage(socket_path: Path) -> None:
    """Hand the vehicle to the companion: preflight, take off, approach."""
    _ask(socket_path, "engage")
    click.echo("engaged")


@click.command()
@_socket_option
def abort(socket_path: Path) -> None:
    """End the companion's flight: hold, and stay out until engaged again."""
    _ask(socket_path, "abort")
    click.echo("aborted")


@click.command()
@_socket_option
@click.option("--json", "as_json", is_flag=True, help="Everything, as JSON.")
def status(socket_path: Path, as_json: bool) -> None:
    """Say what the service is doing."""
    answer = _ask(socket_path, "status")
    if as_json:
        click.echo(json.dumps(answer, indent=2))
        return
    for key, value in answer.items():
        if not isinstance(value, dict) and key != "ok":
            click.echo(f"{key:>20}  {value}")
