"""`companion status`: what the service is doing, for a person or a program, once or every second."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any, Final

import click
from rich.live import Live
from rich.table import Table
from rich.text import Text

from companion.commands.control import asked, radio_lines, socket_option
from companion.commands.status_lines import health_items, person_lines
from companion.commands.terminal import Console, Group, Renderable, wide_console
from companion.errors import CompanionError

_WIDTH: Final = 120
_EVERY_S: Final = 1.0
_STYLES: Final = {"bad": "bold red", "warning": "yellow", "ok": "green"}
_SIGNS: Final = {"bad": "✖", "warning": "!", "ok": "✓"}


@click.command()
@socket_option
@click.option("--json", "as_json", is_flag=True, help="Everything, as JSON; with --watch one line a second.")
@click.option("--watch", is_flag=True, help="Every second, until Ctrl-C.")
def status(socket_path: Path, as_json: bool, watch: bool) -> None:
    """Say what the service is doing, how it is, and what comes next."""
    if watch:
        _watch(socket_path, as_json)
        return
    answer = asked(socket_path, "status")
    if as_json:
        click.echo(json.dumps(answer, indent=2))
    else:
        wide_console(_WIDTH).print(_shown(socket_path, answer))


def _watch(path: Path, as_json: bool) -> None:
    """A service that is gone is waited for: it may be restarting."""
    console = wide_console(_WIDTH)
    try:
        if as_json or not console.is_terminal:
            while True:
                _print_once(path, as_json, console)
                time.sleep(_EVERY_S)
        with Live(console=console, auto_refresh=False) as live:
            while True:
                live.update(_look(path), refresh=True)
                time.sleep(_EVERY_S)
    except KeyboardInterrupt:
        return


def _print_once(path: Path, as_json: bool, console: Console) -> None:
    if not as_json:
        console.print(_look(path))
        return
    try:
        answer = asked(path, "status")
    except CompanionError as error:
        answer = {"ok": False, "error": str(error)}
    click.echo(json.dumps(answer))


def _look(path: Path) -> Renderable:
    try:
        return _shown(path, asked(path, "status"))
    except CompanionError as error:
        return Text(str(error), style=_STYLES["bad"])


def _shown(path: Path, answer: dict[str, Any]) -> Renderable:
    """Lines for a person, the health as a table, and the counters of the radio."""
    try:
        free_mib = _free_mib(Path(answer["about"]["log"]).parent)
        lines = list(person_lines(answer))
        items = health_items(answer, free_mib)
        details = list(radio_lines(answer["health"]))
    except (KeyError, TypeError, AttributeError) as error:
        raise CompanionError(f"{path}: of another version ({error!r}); --json shows all") from None
    health = Table(box=None, padding=(0, 1), show_header=False)
    for item in items:
        style = _STYLES[item.level]
        health.add_row(Text(_SIGNS[item.level], style), Text(item.name), Text(item.text, style), Text(item.todo))
    return Group(
        _two_columns(lines, "bold"), Text("health", "bold"), health, Text("radio", "bold"), _two_columns(details)
    )


def _two_columns(lines: list[tuple[str, str]], first: str = "") -> Table:
    table = Table(box=None, padding=(0, 1), show_header=False)
    table.add_column(justify="right", no_wrap=True)
    for number, (name, text) in enumerate(lines):
        table.add_row(Text(name), Text(text, first if number == 0 else ""))
    return table


def _free_mib(folder: Path) -> float | None:
    try:
        return shutil.disk_usage(folder).free / (1 << 20)
    except OSError:
        return None
