"""A file that is there as a whole or not at all."""

from __future__ import annotations

import os
import tempfile
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
        with target.open("wb") as file:
            yield file
        return
    number, name = tempfile.mkstemp(prefix=".", suffix=".part", dir=target.parent)
    written = Path(name)
    try:
        with os.fdopen(number, "wb") as file:
            yield file
        written.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
        written.replace(target)
    except BaseException:
        written.unlink(missing_ok=True)
        raise


def write_whole(path: Path, text: str) -> None:
    """Raises OSError. A name that is not UTF-8 is written escaped."""
    with whole_file(path) as file:
        file.write(text.encode("utf-8", "backslashreplace"))


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
