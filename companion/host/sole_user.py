"""A file that one process at a time writes: who comes second is told so, and overwrites nothing."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from companion.errors import ConfigError


class SoleUser:
    """The lock beside a file, held until `close` or the end of the process, however it ends (flock). Raises ConfigError
    where another process holds it, OSError where the folder cannot be written."""

    def __init__(self, path: Path, key: str) -> None:
        """`key` is what the configuration names the folder by."""
        # Beside it, since the file itself is replaced as a whole and a lock would go with the one replaced; to read
        # only, since one that another user left there serves as well.
        lock = path.with_name(f".{path.name}.lock")
        self._file = os.fdopen(os.open(lock, os.O_RDONLY | os.O_CREAT, 0o644), "rb")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise ConfigError(
                f"{key}: {path} is in use by another companion service; stop it, or name another folder here: each "
                "would overwrite what the other has accepted"
            ) from None

    def close(self) -> None:
        self._file.close()
