"""The service's end of the camera's process: takes what it tells, on the event loop."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Final

from companion.camera.sighting import MAX_BYTES, SightingError, TagFrame, decode

_log = logging.getLogger(__name__)
_AT_ONCE: Final = 16


class TagSource:
    """`on_frame` is given each frame. `attach` may be called on any thread, with the end of a process that has begun;
    that of the one before is closed."""

    def __init__(self, on_frame: Callable[[TagFrame], None]) -> None:
        self._on_frame = on_frame
        self._loop = asyncio.get_running_loop()
        self._socket: socket.socket | None = None
        self.malformed = 0

    def attach(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._loop.call_soon_threadsafe(self._begin, end)

    def close(self) -> None:
        """Harmless when repeated."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def drain(self) -> None:
        for _ in range(_AT_ONCE):
            if self._socket is None:
                return
            try:
                data = self._socket.recv(MAX_BYTES)
            except BlockingIOError:
                return
            except ConnectionError:
                data = b""
            if not data:  # the process has ended
                self.close()
                return
            try:
                frame = decode(data)
            except SightingError as error:
                if not self.malformed:
                    _log.warning("the tag camera's process told what cannot be: %s; left out, as any further", error)
                self.malformed += 1
                continue
            self._on_frame(frame)

    def _begin(self, end: socket.socket) -> None:
        self.close()
        self._socket = end
        self._loop.add_reader(end, self.drain)
