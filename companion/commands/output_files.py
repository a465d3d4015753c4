"""Files that a command writes at its end: whether they can be is found out before the work, not after it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from companion.analysis.runs import printable
from companion.errors import CompanionError
from companion.host.whole_file import whole_file


def check_writable(file: Path | None, folder: Path | None = None) -> None:
    """Raises CompanionError now rather than after minutes of work. A file that is there stays as it is; a
    folder that is not there is made."""
    if file is not None:
        with writing(file):
            is_new = not file.exists()
            with file.open("a"):
                pass
            if is_new:
                file.unlink()
    if folder is not None:
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()


def json_bytes(value: object) -> bytes:
    """Indented JSON of a dataclass; names of files that are no UTF-8 as they are printed."""
    return msgspec.json.format(msgspec.json.encode(_printable(msgspec.to_builtins(value))), indent=2)


def _printable(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {_printable(key): _printable(item) for key, item in value.items()}
    return [_printable(item) for item in value] if isinstance(value, list | tuple) else value


def write_whole(path: Path, content: bytes) -> None:
    """The file is there whole or as it was. Raises CompanionError."""
    with writing(path), whole_file(path) as file:
        file.write(content)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """An OSError inside becomes a CompanionError that names the file it is of, or `path`."""
    try:
        yield
    except OSError as error:
        raise CompanionError(f"{error.filename or path}: cannot be written: {error.strerror}") from None
