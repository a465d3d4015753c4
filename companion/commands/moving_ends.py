"""Options of commands that read recordings: clocks of trajectories, and transmitters that move."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from companion.analysis.result import Options
from companion.analysis.runs import Run
from companion.commands.numbers import lever_m, offset_s
from companion.core.messages import Vector3

Command = TypeVar("Command", bound=Callable[..., Any])


def moving_ends(command: Command) -> Command:
    """Adds --time-offset, --tx-traj, --tx-time-offset and --tx-lever."""
    for option in reversed(
        [
            click.option(
                "--time-offset",
                type=float,
                default=0.0,
                metavar="S",
                help="Seconds added to the trajectory's stamps, to be on the clock of the receiving robot's host.",
            ),
            click.option(
                "--tx-traj", multiple=True, metavar="NAME=FILE", help="Trajectory of a transmitter that moves."
            ),
            click.option(
                "--tx-time-offset",
                multiple=True,
                metavar="NAME=S",
                help="Seconds added to that trajectory's stamps, to be on the clock of that transmitter's host.",
            ),
            click.option(
                "--tx-lever",
                multiple=True,
                metavar="NAME=F,L,U",
                help="That transmitter's antenna from its tracked point, in metres forward, left, up.",
            ),
        ]
    ):
        command = option(command)
    return command


def with_moving_ends(
    runs: list[Run],
    options: Options,
    time_offset: float,
    tx_traj: tuple[str, ...],
    *,
    tx_time_offset: tuple[str, ...],
    tx_lever: tuple[str, ...],
) -> tuple[list[Run], Options]:
    """The runs with their transmitters' trajectories, and the options with offsets and levers. Raises UsageError."""
    offset_s(f"--time-offset {time_offset}", time_offset)
    paths = {name: Path(text) for name, text in _named("--tx-traj", "FILE", tx_traj)}
    offsets_s = {name: _seconds(name, text) for name, text in _named("--tx-time-offset", "S", tx_time_offset)}
    levers_m = {name: _lever(name, text) for name, text in _named("--tx-lever", "F,L,U", tx_lever)}
    if paths and len(runs) != 1:
        raise click.UsageError(f"--tx-traj is of one run, but {len(runs)} are chosen; choose one with --run")
    _check_known("--tx-traj", paths, runs[0].tx if runs else {})
    for flag, given in (("--tx-time-offset", offsets_s), ("--tx-lever", levers_m)):
        _check_known(flag, given, paths)
    options = replace(options, time_offset_s=time_offset, tx_time_offsets_s=offsets_s, tx_levers_m=levers_m)
    return [replace(run, tx_trajectories=paths) for run in runs], options


def _named(flag: str, what: str, given: Iterable[str]) -> list[tuple[str, str]]:
    found: dict[str, str] = {}
    for text in given:
        name, mark, value = text.partition("=")
        if not mark or not name or not value:
            raise click.UsageError(f"{flag} {text}: expected NAME={what}, with NAME as in the transmitter's file name")
        if name in found:
            raise click.UsageError(f"{flag} {text}: {name} has already been given {found[name]}")
        found[name] = value
    return list(found.items())


def _check_known(flag: str, given: Mapping[str, object], known: Mapping[str, object]) -> None:
    for name in given.keys() - known.keys():
        there = ", ".join(sorted(known)) or "none"
        what = "transmitters" if flag == "--tx-traj" else "transmitters with --tx-traj"
        raise click.UsageError(f"{flag}: {name} is none of the {what}: {there}")


def _seconds(name: str, text: str) -> float:
    return offset_s(f"--tx-time-offset {name}={text}", _number(text))


def _lever(name: str, text: str) -> Vector3:
    return lever_m(f"--tx-lever {name}={text}", tuple(_number(part) for part in text.split(",")))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
