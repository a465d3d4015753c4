"""Opening a file that a person named: everything of ours that reads one opens it here.

Opening a named pipe waits for somebody who writes into it, and a device may have no end and do something when it is
opened. Neither is opened.
"""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path
from typing import Final

_KINDS: Final = (
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


class _Reader(io.BufferedReader):
    """Raises where the file has nothing to give now; its bytes would be None then. The kernel has files that wait."""

    def read(self, size: int | None = -1, /) -> bytes:
        data: bytes | None = super().read(size)
        if data is None:
            raise BlockingIOError(errno.EAGAIN, "gives nothing to read now, expected a file with an end")
        return data


def open_regular(path: str | Path) -> io.BufferedReader:
    """For reading bytes. Raises OSError, whose strerror says what is there instead of a file; never waits."""
    _refuse(path, Path(path).stat().st_mode)
    number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        _refuse(path, os.fstat(number).st_mode)  # it may have been replaced meanwhile
        return _Reader(io.FileIO(number, "rb"))
    except BaseException:
        os.close(number)
        raise


def read_regular(path: str | Path) -> bytes:
    """All of it. Raises OSError as `open_regular` does."""
    with open_regular(path) as file:
        return file.read()


def _refuse(path: str | Path, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    for is_kind, what in _KINDS:
        if is_kind(mode):
            raise OSError(errno.EINVAL, f"{what}, expected a file", str(path))
