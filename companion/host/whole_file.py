"""A file that is there as a whole or not at all, whatever ends the writing of it."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Written beside `path` and put there at the end; what was there stays until then, and stays if writing fails.

    A device or a pipe is written to directly. Raises OSError.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        with os.fdopen(_opened(target, os.O_WRONLY | os.O_TRUNC), "wb") as file:
            yield file
        return
    part = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with part.open("xb") as file:
            yield file
        if target.exists():
            part.chmod(target.stat().st_mode & 0o777)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def try_to_write(path: Path) -> None:
    """A file that is not there is made, and stays; one that is there stays as it is. Raises OSError."""
    os.close(_opened(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT))


def _opened(path: Path, flags: int) -> int:
    """Without waiting for somebody to read a named pipe."""
    try:
        number = os.open(path, flags | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
    except OSError as error:
        if error.errno == errno.ENXIO:
            raise OSError(errno.ENXIO, "a named pipe or a socket that nobody reads", str(path)) from None
        raise
    os.set_blocking(number, True)
    return number


def write_whole(path: Path, text: str) -> None:
    """Raises OSError. A name that is not UTF-8 is written escaped."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8", "backslashreplace"))
