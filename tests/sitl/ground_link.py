"""A ground station at the mock's second link: what pymavlink makes of all that comes there."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

ONBOARD_COMPUTER = 191


class GroundLink:
    """Listens from its beginning on, on a thread of its own."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self._ends = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self.heard: list[tuple[float, Any]] = []
        """Time (monotonic) and message of all that is no telemetry of the autopilot's own."""

    @property
    def options(self) -> tuple[str, ...]:
        """Of the mock."""
        return "--ground", f"127.0.0.1:{self._socket.getsockname()[1]}"

    def __enter__(self) -> GroundLink:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ends = True
        self._thread.join(5)
        self._socket.close()

    def of(self, name: str, since_s: float = 0.0) -> list[Any]:
        return [message for t_s, message in list(self.heard) if message.get_type() == name and t_s >= since_s]

    def sentences(self, since_s: float = 0.0) -> list[str]:
        """Chunks of one id put together, as MAVLink 2 has them."""
        whole: list[str] = []
        newest = 0
        for message in self.of("STATUSTEXT", since_s):
            if message.id and message.id == newest and message.chunk_seq:
                whole[-1] += message.text
            else:
                whole.append(message.text)
            newest = message.id
        return whole

    def values(self, since_s: float = 0.0) -> dict[str, float]:
        """The newest of each name."""
        return {message.name: message.value for message in self.of("NAMED_VALUE_FLOAT", since_s)}

    def wait(self, is_so: Callable[[], bool], timeout_s: float = 30.0) -> None:
        deadline_s = time.monotonic() + timeout_s
        while not is_so():
            assert time.monotonic() < deadline_s, (self.sentences(), self.values())
            time.sleep(0.05)

    def _listen(self) -> None:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        while not self._ends:
            try:
                datagram = self._socket.recv(4096)
            except TimeoutError:
                continue
            for message in parser.parse_buffer(datagram) or ():
                if message.get_srcComponent() != 1:
                    self.heard.append((time.monotonic(), message))
