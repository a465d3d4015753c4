"""`companion doctor`: what is not ready, and what to do about it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

import click
from rich.progress import Progress

from companion.commands.numbers import Number
from companion.commands.output_files import check_writable, write_json
from companion.commands.terminal import Console, bar_columns
from companion.config.file import load_config
from companion.config.schema import Config
from companion.diagnosis.autopilot import autopilot_checks
from companion.diagnosis.camera import camera_checks
from companion.diagnosis.card import card_checks
from companion.diagnosis.installation import installation_checks
from companion.diagnosis.machine import machine_checks
from companion.diagnosis.network import key_checks, network_checks
from companion.errors import CompanionError
from companion.host.control_socket import ask_status
from companion.radio.checks import Check, System, failed, live_checks

_WORDS: Final = {True: "OK", False: "FAILED", None: "?"}
_ROOT: Final = Path("/")
_STATUS_S: Final = 2.0

_config = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    default=Path("/etc/companion/companion.yaml"),
    show_default=True,
    help="Of this robot.",
)
_json = click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the result here.")


def _seconds(default: float) -> Callable[[Any], Any]:
    kind = Number(0.5, 60)
    return click.option("--seconds", type=kind, default=default, show_default=True, help="How long to listen.")


@click.group()
def doctor() -> None:
    """Look at a part of this robot: each line OK, what to do, or ? where it could not be looked at.

    Exit code 1 when anything is wrong. What a running service holds, it is asked for.
    """


@doctor.command()
@_config
@_seconds(3.0)
@_json
def system(config_path: Path, seconds: float, json_path: Path | None) -> None:
    """The machine, the installation, the keys and the robots' network."""
    _report(json_path, _system(load_config(config_path), config_path, seconds))


@doctor.command()
@_config
@_seconds(5.0)
@click.option("--rest", is_flag=True, help="Both robots stand still: also measure how well the cards keep their phase.")
@_json
def radio(config_path: Path, seconds: float, rest: bool, json_path: Path | None) -> None:
    """The card: bus, driver, connector, interface, channel, counters, antennas, packet rates, clock.

    The service must not be running, or csi.source must be netlink; with --rest that of the other robot must.
    """
    config = load_config(config_path)
    _report(json_path, chain(_radio(config, seconds), _at_rest(config, seconds) if rest else ()))


@doctor.command()
@_config
@_seconds(3.0)
@_json
def camera(config_path: Path, seconds: float, json_path: Path | None) -> None:
    """What gives poses: the camera, its reader, and the poses themselves."""
    _report(json_path, _camera(load_config(config_path), seconds))


@doctor.command()
@_config
@_seconds(10.0)
@_json
def autopilot(config_path: Path, seconds: float, json_path: Path | None) -> None:
    """The vehicle: its system id, autopilot and firmware, and each parameter that engage wants, with its value.

    A running service holds the link: stop it to have the parameters read. Nothing is commanded.
    """
    _report(json_path, _autopilot(load_config(config_path), seconds))


@doctor.command(name="all")
@_config
@_seconds(5.0)
@_json
def everything(config_path: Path, seconds: float, json_path: Path | None) -> None:
    """All parts, one after the other."""
    config = load_config(config_path)
    parts = {
        "system": _system(config, config_path, seconds),
        "radio": _radio(config, seconds),
        "camera": _camera(config, seconds),
    }
    if config.autopilot is not None:
        parts["autopilot"] = _autopilot(config, seconds)
    check_writable(json_path)
    told: dict[str, list[Check]] = {}
    for part, checks in parts.items():
        click.echo(f"{part}:")
        told[part] = list(_shown(checks))
    if json_path is not None:
        write_json(json_path, [{"part": part} | asdict(check) for part, checks in told.items() for check in checks])
    failed([check for checks in told.values() for check in checks])


def _report(json_path: Path | None, checks: Iterator[Check]) -> None:
    """Each as soon as it is known. Raises CompanionError when anything is wrong."""
    check_writable(json_path)
    told = list(_shown(checks))
    if json_path is not None:
        write_json(json_path, [asdict(check) for check in told])
    failed(told)


def _system(config: Config, config_path: Path, seconds: float) -> Iterator[Check]:
    yield from machine_checks(config, _ROOT)
    yield from installation_checks(config, config_path, _ROOT)
    yield from key_checks(config)
    yield from asyncio.run(network_checks(config, seconds, _status(config)))


def _radio(config: Config, seconds: float) -> Iterator[Check]:
    wrong: dict[str, bool | None] = {}
    for check in card_checks(config, _ROOT, System()):
        wrong[check.name] = check.ok
        yield check
    if wrong.get("connector") is False:
        yield Check("counters", None, "not listened to: the connector does not deliver")
    elif wrong.get("card") is False and config.csi.source == "nl80211":
        yield Check("counters", None, "not listened to: there is no card")
    else:
        for check in _heard(config, seconds):
            silent = check.name == "counters" and check.ok is False and wrong.get("card") is False
            yield replace(check, ok=None) if silent else check


def _camera(config: Config, seconds: float) -> Iterator[Check]:
    yield from asyncio.run(camera_checks(config, seconds, _ROOT, _status(config)))


def _autopilot(config: Config, seconds: float) -> Iterator[Check]:
    yield from asyncio.run(autopilot_checks(config, seconds, _status(config)))


def _status(config: Config) -> dict[str, Any] | None:
    """Of the service that runs with this configuration, if one does and this user may ask it."""
    try:
        status = asyncio.run(ask_status(config.path(config.control_socket), _STATUS_S))
    except CompanionError:
        return None
    return status if status.get("ok") else None


def _heard(config: Config, seconds: float) -> list[Check]:
    try:
        with _listening(seconds) as update:
            return asyncio.run(live_checks(config, seconds, update))
    except CompanionError as error:
        remedy = "is the service running on the same socket?" if config.csi.source == "unix" else ""
        return [Check("CSI source", False, str(error), remedy)]


def _at_rest(config: Config, seconds: float) -> list[Check]:
    from companion.diagnosis.coherence import rest_checks  # compiled code is below it, which no other check needs

    try:
        with _listening(seconds) as update:
            return asyncio.run(rest_checks(config, seconds, update))
    except CompanionError as error:
        return [Check("phase at rest", None, f"not measured: {error}")]


@contextmanager
def _listening(seconds: float) -> Iterator[Callable[[float], None]]:
    """A bar that fills while it listens. Silent where there is no terminal."""
    console = Console(stderr=True)
    with Progress(*bar_columns(), console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"listening for {seconds:g} s", total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _shown(checks: Iterator[Check]) -> Iterator[Check]:
    for check in checks:
        remedy = f"  -> {check.remedy}" if check.remedy else ""
        click.echo(f"{_WORDS[check.ok]:<7}{check.name:<24}{check.found}{remedy}")
        yield check
