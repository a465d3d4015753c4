"""The times of a signed link on disk, so that no frame is taken twice and none of ours is stamped twice, over restarts.

One small JSON file, replaced as a whole each second by a thread. After an end in order it is exact. After a crash what
was taken since the last writing is unknown: the windows then begin later by more than a period of writing takes.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from companion.errors import ConfigError
from companion.host.sole_user import SoleUser
from companion.signing.frames import UNITS_PER_S, Window
from csi_bridge.regular_file import read_regular

FILE: Final = "mavlink-signing.json"
PERIOD_S: Final = 1.0
GUARD_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class _Written:
    sent: int = 0
    windows: dict[str, int] = field(default_factory=dict)
    """By link/system/component."""
    in_order: bool = False
    """The process that wrote it ended then."""


class SigningBook:
    """Raises ConfigError where the file is none of ours, cannot be written or is another process's."""

    def __init__(self, directory: Path) -> None:
        self._path = directory / FILE
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._sole = SoleUser(self._path, "state_dir")
        except OSError as error:
            raise self._not_written(error) from None
        try:
            self._begin()
        except BaseException as error:
            self._sole.close()
            if isinstance(error, OSError):
                raise self._not_written(error) from None
            raise

    def _begin(self) -> None:
        was = self._read()
        guard = 0 if was.in_order else round(GUARD_S * UNITS_PER_S)
        self.sent = was.sent + guard if was.sent else 0
        self.windows: dict[Window, int] = {_window(name): t + guard for name, t in was.windows.items()}
        self.failed = False
        """The last writing failed: replays after a restart would not be noticed."""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._look: Callable[[], tuple[int, Mapping[Window, int]]] = lambda: (self.sent, self.windows)
        # At once not in order: a crash in the first second counts as one.
        self._write(_Written(self.sent, _named(self.windows)))

    def _not_written(self, error: OSError) -> ConfigError:
        return ConfigError(f"state_dir: {self._path} cannot be written: {error.strerror}")

    def start(self, look: Callable[[], tuple[int, Mapping[Window, int]]]) -> None:
        """Writes each second what `look` says: our own time and the windows."""
        self._look = look
        self._thread = threading.Thread(target=self._run, name="signing book", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """An end in order."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._save(in_order=True)
        self._sole.close()

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            self._save(in_order=False)

    def _save(self, in_order: bool) -> None:
        sent, windows = self._look()
        try:
            self._write(_Written(sent, _named(windows), in_order))
            self.failed = False
        except OSError:
            self.failed = True

    def _write(self, state: _Written) -> None:
        part = self._path.with_name(f".{self._path.name}.part")
        with part.open("wb") as file:
            file.write(msgspec.json.encode(state))
            file.flush()
            os.fsync(file.fileno())
        part.replace(self._path)

    def _read(self) -> _Written:
        try:
            data = read_regular(self._path)
        except FileNotFoundError:
            return _Written(in_order=True)
        except OSError as error:
            raise ConfigError(f"state_dir: {self._path} cannot be read: {error.strerror}") from None
        try:
            was = msgspec.json.decode(data, type=_Written)
            {_window(name) for name in was.windows}
            return was
        except (msgspec.MsgspecError, ValueError):
            raise ConfigError(
                f"state_dir: {self._path} is damaged; without it recorded frames could be played again: remove it to "
                "begin anew"
            ) from None


def _named(windows: Mapping[Window, int]) -> dict[str, int]:
    return {"/".join(map(str, window)): t for window, t in windows.items()}


def _window(name: str) -> Window:
    link, system, component = map(int, name.split("/"))
    return link, system, component
