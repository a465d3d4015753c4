"""The secret files that a configuration names, as the service reads them, where whoever checks it may look at them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from companion.config.schema import Config
from companion.errors import ConfigError
from companion.host.token import read_token
from companion.neighbours.keys import read_key
from companion.signing.key import read_signing_key

_LINE_ENDS: Final = (b"\n", b"\r")


@dataclass(slots=True)
class KeyFiles:
    """What was found, one line for each file, with the key that names it."""

    errors: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What is no error, or could not be looked at."""


def look_at_key_files(config: Config) -> KeyFiles:
    """Of robots, of signing, and the words of pages. A folder that is not on this machine, or that the user may not
    enter, holds files that are looked at elsewhere: a note says so."""
    found, known = KeyFiles(), dict[bytes, tuple[str, int | None]]()
    for key, name, robot, read in _files(config):
        path = config.path(name)
        unseen = _why_unseen(path)
        if unseen:
            found.notes.append(f"{key}: {unseen}; not looked at")
            continue
        try:
            data = read(path)
        except ConfigError as error:
            found.errors.append(f"{key}: {error}")
            continue
        if robot is None or isinstance(data, str):
            continue
        first, owner = known.setdefault(data, (key, robot))
        if owner != robot:
            found.errors.append(
                f"{key}: {path}: holds the same key as {first}; each robot has its own (companion keygen makes one)"
            )
        if data.endswith(_LINE_ENDS) and data.isascii():
            found.notes.append(f"{key}: {path}: the line end behind the text is part of the key, on every robot")
    return found


def _files(config: Config) -> Iterator[tuple[str, str, int | None, Callable[[Path], bytes | str]]]:
    """(key, file, robot whose key it is, how it is read)."""
    yield "neighbours.key_file", config.neighbours.key_file, config.id, read_key
    for index, peer in enumerate(config.peers):
        yield f"peers[{index}].key_file", peer.key_file, peer.id, read_key
        if peer.next_key_file is not None:
            yield f"peers[{index}].next_key_file", peer.next_key_file, peer.id, read_key
    if config.autopilot is not None and config.autopilot.signing_key_file is not None:
        yield "autopilot.signing_key_file", config.autopilot.signing_key_file, None, read_signing_key
    for section, page in (("page", config.page), ("foxglove", config.foxglove)):
        if page.enabled and page.token_file is not None:
            yield f"{section}.token_file", page.token_file, None, read_token


def _why_unseen(path: Path) -> str:
    """Why whoever asks cannot tell what is there; empty when it can be told, also that there is nothing."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return "" if path.parent.exists() else f"there is no folder {path.parent} here"
    except OSError as error:
        return f"{path}: {error.strerror}"
    return "" if os.access(path, os.R_OK) else f"{path}: may not be read by this user"
