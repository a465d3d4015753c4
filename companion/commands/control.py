"""`companion engage | abort`: commands to a running service over its control socket."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import click

from companion.errors import CompanionError
from companion.host.control_socket import ask, ask_status

_ANSWER_S: Final = 5.0
_ENGAGE_S: Final = 10.0
"""The autopilot's parameters are read before it is answered, which takes up to 3 s."""

socket_option = click.option(
    "--socket",
    "socket_path",
    type=click.Path(path_type=Path, readable=False),  # whoever may not, asks the status socket beside it
    default=Path("/run/companion/control.sock"),
    show_default=True,
    help="Control socket of the service.",
)


def asked(path: Path, command: str, target: str | None = None) -> dict[str, Any]:
    """The answer of the service at `path`. Raises CompanionError when it refuses, or none is there."""
    wait_s = _ENGAGE_S if command == "engage" else _ANSWER_S
    answer = asyncio.run(ask_status(path) if command == "status" else ask(path, command, wait_s, target))
    if not answer.get("ok"):
        raise CompanionError(f"{command} refused: {answer.get('error', 'no reason given')}")
    return answer


@click.command()
@socket_option
@click.option("--target", metavar="NAME", help="Name or id of the robot to fly to; in flight, instead of another one.")
def engage(socket_path: Path, target: str | None) -> None:
    """Hand the vehicle to the companion: preflight, take off, approach; in flight, to another --target."""
    answer = asked(socket_path, "engage", target)
    told = f": {answer['vehicle']}" if "vehicle" in answer else ""
    click.echo(f"engaged{told}" + (f", to {answer['target']}" if "target" in answer else ""))


@click.command()
@socket_option
def abort(socket_path: Path) -> None:
    """End the companion's flight: hold, and stay out until engaged again."""
    asked(socket_path, "abort")
    click.echo("aborted")


def radio_lines(health: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """(label, what a person wants to know) of the card, the neighbours and the interfaces, from a service's health."""
    if (radio := health.get("radio")) is not None:
        refused = radio["malformed"] + radio["unknown_sender"] + radio["no_sender"] + radio["wide"]
        wide = f" ({radio['wide']} of 40 MHz)" if radio["wide"] else ""
        seen = f"{radio['samples']} packets of neighbours, {refused} of others or unusable{wide}"
        yield "card", f"{seen}, {radio['lost']} counted by the driver and never seen"
    for name, neighbour in health.get("neighbours", {}).items():
        yield f"neighbour {name}", ", ".join(_neighbour(neighbour))
    if "link" in health:
        strangers = {key: health["link"][key] for key in ("unknown_sender", "malformed", "version")}
        yield "strangers", ", ".join(f"{count} {_words(key)}" for key, count in strangers.items())
    if health.get("network_problem"):
        yield "robots' network", f"{health['network_problem']}; {health['link']['unsent']} datagrams not sent"
    for name, rate in health.get("interfaces", {}).items():
        yield f"sent at {name}", f"{rate / 1000:.1f} KB/s"
    for pair in health.get("lookalikes", ()):
        yield "look alike", f"{' and '.join(pair)}: one transmitter behind both?"


def _neighbour(neighbour: dict[str, Any]) -> Iterator[str]:
    yield f"{neighbour['state']}, {neighbour['accepted']} datagrams"
    if neighbour["pairing_rate"] is not None:
        yield f"{100 * neighbour['pairing_rate']:.0f} % of its packets paired"
    if neighbour["clock_offset_s"] is not None:
        uncertainty_ms = 1e3 * neighbour["clock_uncertainty_s"]
        yield f"its clock {neighbour['clock_offset_s']:+.4f} s from ours, uncertain by {uncertainty_ms:.1f} ms"
    if neighbour["round_trip_s"] is not None:
        yield f"round trip {1e3 * neighbour['round_trip_s']:.1f} ms"
    for reason, count in neighbour["refused"].items():
        if count:
            yield f"{count} refused: {_words(reason)}"


def _words(key: str) -> str:
    return key.replace("_", " ")
