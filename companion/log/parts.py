"""The files of a recording: which name comes next, which is being written, which may go."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from companion.errors import CompanionError
from companion.log.writer import Compression, LogWriter
from companion.streams import Stream


class LogPart:
    """One file being written. Locked (flock) while it is, so that nobody takes it for finished."""

    def __init__(self, first: Path, path: Path, file: BinaryIO, writer: LogWriter) -> None:
        self._first = first
        self._path = path
        self._file = file
        self._writer = writer
        self._start = time.monotonic()
        self._unflushed = 0

    @property
    def size_bytes(self) -> int:
        """Of what has been flushed."""
        return self._file.tell()

    @property
    def age_s(self) -> float:
        return time.monotonic() - self._start

    def write(self, stream: Stream, log_time_ns: int, publish_time_ns: int, event: int, message: Any) -> None:
        self._unflushed += 1
        self._writer.write(stream, log_time_ns, publish_time_ns, event, message)

    def flush(self, sync: bool) -> None:
        """Ends the chunk; with `sync` it is on the disk when this returns. Raises OSError."""
        self._writer.flush()
        if sync:
            os.fsync(self._file.fileno())
        self._unflushed = 0

    def finish(self) -> None:
        """Raises OSError."""
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> int:
        """Lets go of a file that cannot be written any more; how many messages of it are lost."""
        with contextlib.suppress(OSError):  # the same error again, from what was still buffered
            self._file.close()
        return self._unflushed

    def remove_oldest(self, budget_bytes: int) -> int:
        """Removes the oldest finished files of this recording's name until the others fit; how many went."""
        removed = 0
        others = [path for path in parts_beside(self._first) if path != self._path]
        sizes = {path: path.stat().st_size for path in others}
        for path in others:
            if sum(sizes.values()) <= budget_bytes:
                break
            if not _is_being_written(path):
                path.unlink(missing_ok=True)
                del sizes[path]
                removed += 1
        return removed


def open_part(first: Path, metadata: Mapping[str, str], compression: Compression, chunk_bytes: int) -> LogPart:
    """The next free file of a recording. Raises CompanionError when it cannot be created."""
    try:
        first.parent.mkdir(parents=True, exist_ok=True)
        path, file = _create(first)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            writer = LogWriter(file, metadata, compression, chunk_bytes)
            file.flush()
        except OSError:
            with contextlib.suppress(OSError):
                file.close()
            raise
        return LogPart(first, path, file, writer)
    except OSError as error:
        raise CompanionError(f"{first}: cannot write the log: {error.strerror}") from None


def parts_beside(first: Path) -> list[Path]:
    """All files of a recording's name (log.mcap, log.1.mcap, ...), oldest first."""
    pattern = re.compile(re.escape(first.stem) + r"(?:\.(\d+))?" + re.escape(first.suffix))
    found = ((pattern.fullmatch(path.name), path) for path in _files(first.parent))
    numbered = [(int(match[1] or 0), path) for match, path in found if match is not None]
    return [path for _, path in sorted(numbered)]


def _files(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(FileNotFoundError):
        yield from (path for path in folder.iterdir() if path.is_file())


def _create(first: Path) -> tuple[Path, BinaryIO]:
    if first.is_char_device():
        return first, first.open("wb")
    there = parts_beside(first)
    number = 0
    if there:
        suffixes = there[-1].name.removeprefix(first.stem).removesuffix(first.suffix)
        number = int(suffixes.lstrip(".") or 0) + 1
    while True:
        path = first if number == 0 else first.with_suffix(f".{number}{first.suffix}")
        with contextlib.suppress(FileExistsError):
            return path, path.open("xb")
        number += 1


def _is_being_written(path: Path) -> bool:
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False
