"""The `companion` command. Commands are imported only when called, so that the service starts fast."""

from __future__ import annotations

import contextlib
import errno
import importlib
import io
import os
import sys
from pathlib import Path
from typing import Final

import click

from companion import __version__
from companion.errors import CompanionError, ConfigError, escaped

_COMMANDS: Final = {
    "run": "the service: role uav or beacon, as its configuration says",
    "engage": "hand the vehicle to the companion (a deliberate act, never done at start)",
    "abort": "end the companion's flight: leave its mode and stay out",
    "status": "what the service is doing",
    "feed": "play a recorded CSI log to the service, as the driver would",
    "config": "check a configuration, show what is in force, print examples",
    "keygen": "secret keys for the robots' datagrams",
    "doctor": "what is not ready, and what to do about it",
    "radio": "as root: monitor mode, channel and the driver's switches",
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
_STDERR: Final = 2
_OF_WRITING: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_MODULES: Final = {"engage": "control", "abort": "control", "check-axes": "check_axes"}


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

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        if command is not None:
            _refuse_twice(command, click.Context(command, parent=ctx, info_name=name), rest)
        return name, command, rest

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


def _refuse_twice(command: click.Command, ctx: click.Context, args: list[str]) -> None:
    """Of two values of one option click takes the last and says nothing. Raises UsageError, also of a group's own
    commands."""
    _, rest, order = command.make_parser(ctx).parse_args(list(args))
    for option in order:
        once = isinstance(option, click.Option) and not (option.multiple or option.is_flag or option.count)
        if once and order.count(option) > 1:
            raise click.UsageError(f"{max(option.opts, key=len)} is given twice; expected once", ctx)
    if isinstance(command, click.Group) and rest and (inner := command.get_command(ctx, rest[0])) is not None:
        _refuse_twice(inner, click.Context(inner, parent=ctx, info_name=rest[0]), rest[1:])


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="companion")
def program() -> None:
    """A drone finds another robot through walls from WiFi channel measurements."""


def main() -> None:
    """Entry point: exit 0 done, 1 the job failed, 2 usage or configuration.

    What the operating system refuses, and what no parser has translated, becomes one line here, for all commands.
    """
    _have_streams()
    _print_anything()
    code = _run()
    try:
        sys.stdout.flush()
    except OSError as error:
        code = code or _fail(f"standard output: {error.strerror}")
        _let_go_of_stdout()
    sys.exit(code)


def _run() -> int:
    if "" in sys.argv[1:]:  # as a path it would be the folder we are in
        return _fail("an empty argument; expected a value: is a variable of the shell not set?", ConfigError.exit_code)
    try:
        program([_at_home(word) for word in sys.argv[1:]], standalone_mode=True)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except CompanionError as error:
        return _fail(str(error), error.exit_code)
    except OSError as error:
        return _fail(f"{_name_of(error)}{error.strerror or error}")
    except UnicodeError as error:
        return _fail(f"not UTF-8: {error}")
    except RecursionError:
        return _fail("what was read is nested too deep")
    except MemoryError:
        return _fail("what was read needs more memory than there is")
    return 0


def _at_home(word: str) -> str:
    """`--out=~/x`, which no shell expands, would make a folder named ~."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    try:
        return f"{option}{equals}{Path(value).expanduser()}" if value.startswith("~/") else word
    except RuntimeError:  # nobody's home is known
        return word


def _fail(text: str, code: int = 1) -> int:
    click.echo(f"companion: {escaped(text)}", err=True)
    return code


def _name_of(error: OSError) -> str:
    name = error.filename2 or error.filename
    if name is None and error.errno in _OF_WRITING:  # all other files are named where they are written
        return "standard output: "
    return f"{os.fsdecode(name)}: " if isinstance(name, str | bytes) else ""


def _have_streams() -> None:
    """Whoever starts us may have closed them (`>&-`). Then what is opened next would have their numbers, and what a
    library prints would be written into a log."""
    while True:
        number = os.open(os.devnull, os.O_RDWR)
        if number > _STDERR:
            os.close(number)
            break
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115 - for as long as the process


def _print_anything() -> None:
    """Names of files need not be UTF-8: they are shown escaped."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _let_go_of_stdout() -> None:
    """What it still holds would fail again when the interpreter ends."""
    with contextlib.suppress(OSError, ValueError):
        number = os.open(os.devnull, os.O_WRONLY)
        os.dup2(number, sys.stdout.fileno())
        os.close(number)
