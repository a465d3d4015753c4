"""Files that a command writes at its end: whether they can be is found out before the work, not after it."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from companion.errors import CompanionError
from companion.host.whole_file import write_whole


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


def write_json(path: Path, content: object) -> None:
    """As a whole or not at all. Raises CompanionError."""
    with writing(path):
        write_whole(path, json.dumps(content, indent=2, default=str) + "\n")


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
    except OSError as error:
        raise CompanionError(f"{error.filename or path}: cannot be written: {error.strerror or error}") from None
