"""The files of a recording: which name comes next, which is being written, which may go."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import re
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from companion.core.streams import Stream
from companion.errors import CompanionError, ConfigError
from companion.log.writer import Compression, LogWriter
from csi_bridge.regular_file import open_regular


class LogPart:
    """One file being written. Locked (flock) while it is, so that nobody takes it for finished."""

    def __init__(self, file: BinaryIO, writer: LogWriter) -> None:
        self._file = file
        self._writer = writer
        self._start_s = self._synced_s = time.monotonic()
        self._waiting = self._taken = 0
        self._is_unsynced = False
        self.oldest_s = math.inf
        """When the oldest message of the chunk that has not ended was taken (monotonic); inf while it is empty."""

    @property
    def finished_bytes(self) -> int:
        """What the file would measure, finished at the end of this chunk; at most."""
        return self._file.tell() + self._writer.index_bytes

    @property
    def unsynced_since_s(self) -> float:
        """When the last sync was (monotonic), if a chunk has ended since; else inf."""
        return self._synced_s if self._is_unsynced else math.inf

    @property
    def age_s(self) -> float:
        return time.monotonic() - self._start_s

    def write(
        self, stream: Stream, log_time_ns: int, publish_time_ns: int, event: int, *, message: Any, taken_s: float
    ) -> bool:
        """Whether that made the chunk full and ended it. `taken_s` as in `oldest_s`. Raises OSError."""
        chunks = self._writer.chunks
        self.oldest_s = min(self.oldest_s, taken_s)
        self._writer.write(stream, log_time_ns, publish_time_ns, event, message=message)
        self._taken += 1
        if self._writer.chunks == chunks:
            self._waiting += 1
            return False
        self._is_unsynced = True
        # Views of the message may be in the next chunk already.
        self._waiting, self.oldest_s = (1, taken_s) if self._writer.open_bytes else (0, math.inf)
        return True

    def end_chunk(self) -> None:
        """Raises OSError."""
        self._writer.end_chunk()
        self._is_unsynced = True
        self._waiting, self.oldest_s = 0, math.inf

    def sync(self, unless_within_s: float) -> None:
        """What is in the file is on the disk when this returns, unless that was so a moment ago. Raises OSError, also
        where somebody has removed the file: the system would go on taking what nobody will ever read."""
        if time.monotonic() - self._synced_s >= unless_within_s:
            os.fsync(self._file.fileno())
            self._synced_s = time.monotonic()
            self._is_unsynced = False
            if self._is_removed():
                raise FileNotFoundError(errno.ENOENT, "the log was removed", self._file.name)

    def finish(self) -> None:
        """Raises OSError."""
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def abandon(self) -> int:
        """Lets go of a file that cannot be written any more; how many messages of it are lost."""
        lost = self._taken if self._is_removed() else self._waiting
        with contextlib.suppress(OSError):  # the same error again, from what was still buffered
            self._file.close()
        return lost

    def _is_removed(self) -> bool:
        return os.fstat(self._file.fileno()).st_nlink == 0


def open_part(first: Path, metadata: Mapping[str, str], compression: Compression, chunk_bytes: int) -> LogPart:
    """The next free file of a recording. Raises CompanionError when it cannot be created, ConfigError where its folder
    is not there: made here, it would hide that a disk was not mounted."""
    try:
        if first.is_dir():
            raise ConfigError(f"recorder.path {first}: a folder; expected a file, for example {first / 'log.mcap'}")
        if not first.parent.is_dir():
            raise ConfigError(f"recorder.path {first}: there is no folder {first.parent}; make it, or name another")
        file = _create(first)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            writer = LogWriter(file, metadata, compression, chunk_bytes)
            file.flush()
        except OSError:
            with contextlib.suppress(OSError):
                file.close()
            if not first.is_char_device():
                with contextlib.suppress(OSError):
                    Path(file.name).unlink()
            raise
        return LogPart(file, writer)
    except OSError as error:
        raise CompanionError(f"{first}: cannot write the log: {error.strerror}") from None


def remove_oldest(first: Path, budget_bytes: int) -> int:
    """Removes the oldest finished files of a recording's name until all of them fit; how many went. One that is
    another user's, and may not be read or removed by us, stays. Raises CompanionError when they cannot be listed."""
    removed = 0
    try:
        sizes = {path: path.stat().st_size for path in parts_beside(first)}
        for path in list(sizes):
            if sum(sizes.values()) <= budget_bytes:
                break
            if not _may_go(path):
                continue
            with contextlib.suppress(PermissionError):
                path.unlink(missing_ok=True)
                del sizes[path]
                removed += 1
    except OSError as error:
        raise CompanionError(f"{first}: cannot write the log: {error.strerror}") from None
    return removed


def parts_beside(first: Path) -> list[Path]:
    """All files of a recording's name (log.mcap, log.1.mcap, ...), oldest first."""
    pattern = re.compile(re.escape(first.stem) + r"(?:\.(\d+))?" + re.escape(first.suffix))
    found = ((pattern.fullmatch(path.name), path) for path in _files(first.parent))
    numbered = [(int(match[1] or 0), path) for match, path in found if match is not None]
    return [path for _, path in sorted(numbered)]


def _files(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(FileNotFoundError):
        yield from (path for path in folder.iterdir() if path.is_file())


def _create(first: Path) -> BinaryIO:
    if first.is_char_device():
        return first.open("wb")
    there = parts_beside(first)
    number = 0
    if there:
        suffixes = there[-1].name.removeprefix(first.stem).removesuffix(first.suffix)
        number = int(suffixes.lstrip(".") or 0) + 1
    while True:
        path = first if number == 0 else first.with_suffix(f".{number}{first.suffix}")
        with contextlib.suppress(FileExistsError):
            return path.open("xb")
        number += 1


def _may_go(path: Path) -> bool:
    """Whether nobody writes it, as far as we can see."""
    try:
        with open_regular(path) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
