"""Files that a command writes at its end: whether they can be is found out before the work, not after it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import msgspec

from companion.analysis.runs import TRUTH_NAME, printable
from companion.errors import CompanionError
from companion.host.whole_file import try_to_write, write_whole
from csi_bridge.regular_file import open_regular

JSON: Final = "JSON"
PAGE: Final = "page"
PICTURE: Final = "picture"
TEXT: Final = "text"
_BEGINS: Final = {JSON: b"{[", PAGE: b"<", PICTURE: b"\x89"}
"""Each with what a file of it may begin with; text is whatever has no zero byte."""
_LOOK_BYTES: Final = 4096


def check_writable(file: Path | None, folder: Path | None = None, kind: str = JSON) -> None:
    """Raises CompanionError now rather than after minutes of work. A file that is there stays as it is, and must be of
    the `kind` that will take its place; a folder that is not there is made."""
    if file == Path("-"):
        raise CompanionError("-: would be a file of this name; expected another (/dev/stdout for standard output)")
    if file is not None:
        with writing(file):
            _refuse_another_kind(file, kind)
            is_new = not file.exists()
            try_to_write(file)
            if is_new:
                file.unlink()
    if folder is not None:
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()


def _refuse_another_kind(file: Path, kind: str) -> None:
    """A slip of the pen gives the name of a log, or of any other file, where a result goes: it would be lost. Raises
    OSError and CompanionError."""
    if not file.is_file():
        return
    with open_regular(file) as there:
        begun = there.read(_LOOK_BYTES)
    first = begun.removeprefix(b"\xef\xbb\xbf").lstrip()[:1]
    is_like = b"\0" not in begun if kind == TEXT else first in _BEGINS[kind]
    if not is_like or file.name == TRUTH_NAME:
        raise CompanionError(
            f"{file}: is there already, and no {kind} of ours; choose another name, or delete it first"
        )


def write_json(path: Path, content: object) -> None:
    """Dataclasses or plain values, indented, as a whole or not at all. Raises CompanionError.

    What is no number is null, and names of files that are no UTF-8 are as they are printed.
    """
    plain = _printable(msgspec.to_builtins(content, enc_hook=_plain))
    with writing(path):
        _refuse_another_kind(path, JSON)
        write_whole(path, msgspec.json.format(msgspec.json.encode(plain), indent=2).decode() + "\n")


def _plain(value: object) -> object:
    return float(value) if isinstance(value, float) else str(value)


def _printable(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {_printable(key): _printable(item) for key, item in value.items()}
    return [_printable(item) for item in value] if isinstance(value, list | tuple) else value


@contextmanager
def new_folder(folder: Path) -> Iterator[None]:
    """A folder that nothing came into, because the work failed, is not left behind."""
    is_new = not folder.exists()
    try:
        yield
    except CompanionError:
        if is_new and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """An OSError inside becomes a CompanionError that names the file it is of, or `path`."""
    try:
        yield
    except FileExistsError as error:
        raise CompanionError(
            f"{error.filename or path}: cannot be written: no folder; expected one, or a new name"
        ) from None
    except OSError as error:
        raise CompanionError(f"{error.filename or path}: cannot be written: {error.strerror or error}") from None
