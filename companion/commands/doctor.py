"""`companion doctor`: what is not ready, and what to do about it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import click
from rich.progress import Progress

from companion.commands.doctor_autopilot import autopilot_checks
from companion.commands.numbers import Number
from companion.commands.output_files import check_writable, write_json
from companion.commands.terminal import Console, bar_columns
from companion.config.file import load_config
from companion.config.schema import Config
from companion.errors import CompanionError
from companion.radio.checks import Check, System, failed, live_checks, static_checks

_WORDS = {True: "OK", False: "FAILED", None: "?"}


@click.group()
def doctor() -> None:
    """Look at a part of this robot: each line OK, or what to do."""


@doctor.command()
@click.option("--config", "config_path", type=click.Path(path_type=Path), required=True, help="Of this robot.")
@click.option("--seconds", type=Number(0.5, 60), default=5.0, show_default=True, help="How long to listen.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the result here.")
def radio(config_path: Path, seconds: float, json_path: Path | None) -> None:
    """The card: driver, connector, interface, channel, counters, antennas, packet rates, clock.

    The service must not be running, or csi.source must be netlink. Exit code 1 when anything is wrong.
    """
    config = load_config(config_path)
    check_writable(json_path)
    checks = []
    for check in static_checks(config, System()):
        _show(check)
        checks.append(check)
    if any(check.name == "connector" and check.ok is False for check in checks):
        heard = [Check("counters", None, "not listened to: the connector does not deliver")]
    else:
        heard = _heard(config, seconds)
    for check in heard:
        _show(check)
    checks += heard
    if json_path is not None:
        write_json(json_path, [asdict(check) for check in checks])
    failed(checks)


@doctor.command()
@click.option("--config", "config_path", type=click.Path(path_type=Path), required=True, help="Of this robot.")
@click.option("--seconds", type=Number(0.5, 60), default=10.0, show_default=True, help="How long to wait.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the result here.")
def autopilot(config_path: Path, seconds: float, json_path: Path | None) -> None:
    """The vehicle: its system id, autopilot and firmware, and the parameters that engage wants.

    The service must not be running: it holds the link. Nothing is commanded. Exit code 1 when anything is wrong.
    """
    config = load_config(config_path)
    check_writable(json_path)
    checks = asyncio.run(autopilot_checks(config, seconds))
    for check in checks:
        _show(check)
    if json_path is not None:
        write_json(json_path, [asdict(check) for check in checks])
    failed(checks)


def _heard(config: Config, seconds: float) -> list[Check]:
    try:
        with _listening(seconds) as update:
            return asyncio.run(live_checks(config, seconds, update))
    except CompanionError as error:
        remedy = "is the service running on the same socket?" if config.csi.source == "unix" else ""
        return [Check("CSI source", False, str(error), remedy)]


@contextmanager
def _listening(seconds: float) -> Iterator[Callable[[float], None]]:
    """A bar that fills while it listens. Silent where there is no terminal."""
    console = Console(stderr=True)
    with Progress(*bar_columns(), console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"listening for {seconds:g} s", total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _show(check: Check) -> None:
    remedy = f"  -> {check.remedy}" if check.remedy else ""
    click.echo(f"{_WORDS[check.ok]:<7}{check.name:<24}{check.found}{remedy}")
