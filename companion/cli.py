"""The `companion` command. Commands are imported only when called, so that the service starts fast."""

from __future__ import annotations

import importlib
import sys
from typing import Final

import click

from companion.errors import CompanionError

_COMMANDS: Final = {
    "run": "the service: role uav or beacon, as its configuration says",
    "engage": "hand the vehicle to the companion (a deliberate act, never done at start)",
    "abort": "end the companion's flight: leave its mode and stay out",
    "status": "what the service is doing",
    "feed": "play a recorded CSI log to the service, as the driver would",
    "keygen": "secret keys for the robots' datagrams",
    "doctor": "what is not ready, and what to do about it",
    "check-axes": "move the vehicle by hand and see whether the axes are right",
    "demo": "a full simulated rendezvous",
    "csi": "what a log of CSI holds, of whichever card",
    "analyze": "a bearing from a real recording",
    "evaluate": "bearings of a whole data set against its truth",
    "study": "what the paper derives or simulates, beside its own numbers",
    "log": "flight logs: info, repair, export, merge, import",
    "replay": "a recorded flight decided again by the same code",
    "report": "a flight log as one page",
}
_MODULES: Final = {"engage": "control", "abort": "control", "status": "control", "check-axes": "check_axes"}


class _LazyGroup(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module = importlib.import_module(f"companion.commands.{_MODULES.get(cmd_name, cmd_name)}")
        command = getattr(module, cmd_name.replace("-", "_"))
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="wsr-companion")
def program() -> None:
    """A drone finds another robot through walls from WiFi channel measurements."""


def main() -> None:
    """Entry point: exit 0 done, 1 the job failed, 2 usage or configuration."""
    try:
        program(standalone_mode=True)
    except CompanionError as error:
        click.echo(f"companion: {error}", err=True)
        sys.exit(error.exit_code)
