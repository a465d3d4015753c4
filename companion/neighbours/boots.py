"""What must outlive a restart so that no datagram is accepted twice: our own boot number, and how far each sender got.

One small JSON file, replaced as a whole. The counters are reserved ahead: what is on disk is a ceiling that no accepted
counter has passed, so that after a crash nothing that was accepted can be accepted again; at most the datagrams of the
reserve, a few seconds, are refused then.
"""

from __future__ import annotations

import logging
import os
import secrets
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

import msgspec

from companion.core.inputs import Reached
from companion.errors import ConfigError
from companion.host.sole_user import SoleUser
from csi_bridge.regular_file import read_regular

_log = logging.getLogger(__name__)
RESERVE: Final = 50
_REFILL: Final = 25
_FILE: Final = "boots.json"


@dataclass(slots=True)
class _State:
    own: int = 0
    senders: dict[int, Reached] = field(default_factory=dict)


class Book(Protocol):
    """Who has been heard up to where."""

    own_boot_id: int
    failed: bool

    def reached(self, sender: int) -> Reached | None: ...

    def note(self, sender: int, boot_id: int, counter: int) -> None:
        """A datagram is accepted."""

    def close(self) -> None: ...


class BootBook:
    """Raises ConfigError when `directory` cannot be written, another process has its book open, or the file in it is
    none of ours."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / _FILE
        self.failed = False
        """The last write failed: replays after a restart would not be noticed."""
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._sole = SoleUser(self._path, "state_dir")
        except OSError as error:
            raise self._not_written(error) from None
        try:
            self._state = self._read()
            self._state.own += 1
            _write(self._path, self._encoded())
        except BaseException as error:
            self._sole.close()
            if isinstance(error, OSError):
                raise self._not_written(error) from None
            raise
        self.own_boot_id = self._state.own << 32 | secrets.randbits(32)
        """Boot number in the upper 32 bits, random in the lower: higher than that of every start before."""
        self._writer = ThreadPoolExecutor(1, "boots")
        self._written: Future[None] | None = None

    def reached(self, sender: int) -> Reached | None:
        return self._state.senders.get(sender)

    def note(self, sender: int, boot_id: int, counter: int) -> None:
        """A datagram is accepted. Writes, on a thread of its own, only when the reserve runs low."""
        old = self._state.senders.get(sender)
        if old is not None and old.boot_id == boot_id and counter <= old.ceiling - _REFILL:
            return
        ceiling = counter + RESERVE
        if old is not None and old.boot_id == boot_id:
            ceiling = max(ceiling, old.ceiling)
        self._state.senders[sender] = Reached(boot_id, ceiling)
        self._written = self._writer.submit(self._save, self._encoded())

    def close(self) -> None:
        """Waits until everything is on disk."""
        self._writer.shutdown(wait=True)
        self._sole.close()

    def _save(self, data: bytes) -> None:
        try:
            _write(self._path, data)
            self.failed = False
        except OSError as error:
            if not self.failed:
                _log.error("%s: cannot be written: %s", self._path, error.strerror)
            self.failed = True

    def _not_written(self, error: OSError) -> ConfigError:
        return ConfigError(f"state_dir: {self._path} cannot be written: {error.strerror}")

    def _read(self) -> _State:
        try:
            return msgspec.json.decode(read_regular(self._path), type=_State)
        except FileNotFoundError:
            return _State()
        except OSError as error:
            raise ConfigError(f"state_dir: {self._path} cannot be read: {error.strerror}") from None
        except msgspec.DecodeError as error:
            raise ConfigError(
                f"state_dir: {self._path} is no record of boots ({error}); without it old datagrams would be accepted "
                "again, so give all robots new keys before removing it"
            ) from None

    def _encoded(self) -> bytes:
        return msgspec.json.encode(self._state)


def _write(path: Path, data: bytes) -> None:
    """Whole or not at all, and on disk when this returns."""
    new = path.with_suffix(".new")
    with new.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
