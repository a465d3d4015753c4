"""`companion config`: a configuration looked at without running anything."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import click
import msgspec

from companion.config.file import load_config, text_of
from companion.config.json_schema import json_schema, keys_of
from companion.config.origins import ValueOrigin, origins
from companion.config.unit_settings import drop_in
from companion.diagnosis.key_files import look_at_key_files
from companion.errors import ConfigError
from companion.shipped.files import shipped_paths, shipped_text

_file = click.argument("path", type=click.Path(path_type=Path), metavar="FILE")


@click.group()
def config() -> None:
    """Check a configuration, show what is in force, print examples and the schema for editors."""


@config.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
def check(paths: tuple[Path, ...]) -> None:
    """Read each FILE as the service does, with the key files it names. Exit code 2 with every error of the first that
    has one."""
    for path in paths:
        read = load_config(path)
        files = look_at_key_files(read)
        for note in files.notes:
            click.echo(f"{path}: {note}", err=True)
        if files.errors:
            count = "1 error" if len(files.errors) == 1 else f"{len(files.errors)} errors"
            raise ConfigError(f"{path}: {count}\n" + "\n".join(f"  {line}" for line in files.errors))
        peers = ", ".join(f"{peer.id} {peer.name}" for peer in read.peers)
        click.echo(f"{path}: OK, role {read.role}, robot {read.id} {read.name}, peers {peers}")


@config.command()
@_file
@click.option("--json", "as_json", is_flag=True, help="As JSON.")
def show(path: Path, as_json: bool) -> None:
    """The values in force, each with where it came from: FILE:LINE, or the default."""
    read = load_config(path)
    rows = list(origins(read, text_of(path)))
    if as_json:
        plain = [msgspec.to_builtins(row) | {"where": _where(row, path)} for row in rows]
        click.echo(json.dumps(plain, indent=2))
        return
    widths = max(len(row.key) for row in rows), min(40, max(len(_shown(row.value)) for row in rows))
    for row in rows:
        click.echo(f"{row.key:<{widths[0]}}  {_shown(row.value):<{widths[1]}}  {_where(row, path)}")


@config.command()
@click.option("--since", type=click.Path(path_type=Path), help="An older schema: print the keys that it does not have.")
def schema(since: Path | None) -> None:
    """The JSON schema of a configuration, for editors."""
    if since is None:
        click.echo(json.dumps(json_schema(), indent=2))
        return
    for line in _new_keys(_read_schema(since)):
        click.echo(line)


@config.command()
@click.argument("name", required=False)
def example(name: str | None) -> None:
    """Print the file NAME that goes with the program: uav, beacon, gps, companion.service. Without NAME all names."""
    named = {_name(path): path for path in shipped_paths()}
    if name is None:
        for each in sorted(named):
            click.echo(each)
        return
    if name not in named:
        raise ConfigError(f"{name}: no such example; there are {', '.join(sorted(named))}")
    click.echo(shipped_text(named[name]), nl=False)


@config.command()
@_file
def units(path: Path) -> None:
    """Print what this configuration needs of its unit beside what every one has, as a drop-in of systemd."""
    click.echo(drop_in(load_config(path)), nl=False)


def _name(path: str) -> str:
    """uav of configs/uav.yaml, gps of configs/px4/gps.params; of others the file's own name."""
    file = PurePosixPath(path)
    return file.stem if file.suffix in (".yaml", ".params") else file.name


def _shown(value: object) -> str:
    return json.dumps(msgspec.to_builtins(value))


def _where(row: ValueOrigin, path: Path) -> str:
    if row.line is not None:
        return f"{path}:{row.line}"
    return f"default ({row.why})" if row.why else "default"


def _read_schema(path: Path) -> dict[str, Any]:
    try:
        read = json.loads(text_of(path))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: no schema of a configuration: {error}") from None
    if not isinstance(read, dict):
        raise ConfigError(f"{path}: no schema of a configuration: expected an object")
    return read


def _new_keys(old: dict[str, Any]) -> Iterator[str]:
    before, now = keys_of(old), keys_of(json_schema())
    for key, described in now.items():
        if key not in before:
            default = f" (default {json.dumps(described['default'])})" if "default" in described else ""
            yield f"new key {key}{default}: {described.get('description', 'a section')}"
    for key in before:
        if key not in now:
            yield f"key {key} is no longer known: take it out of the configuration"
