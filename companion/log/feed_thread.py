"""A thread that sends what a service tells to a process beside it, over a socket and without ever waiting for it."""

from __future__ import annotations

import contextlib
import socket
import threading
from abc import ABC, abstractmethod
from typing import Final

_SEND_BYTES: Final = 1 << 20


class FeedThread(ABC):
    """`attach` and `detach` belong to whoever starts the process that is fed; the rest of what a subclass has to its
    thread, which holds the lock meanwhile, but for what the event loop appends."""

    def __init__(self, name: str, period_s: float) -> None:
        self._name, self._period_s = name, period_s
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.sent = 0
        self.dropped = 0
        """Messages that were not taken in time."""

    def start(self) -> None:
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Sends what is left and ends the thread. Harmless when repeated."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self.detach()

    def attach(self, sender: socket.socket) -> None:
        """Sends there from now on, beginning with the newest of everything. Takes the socket over."""
        sender.setblocking(False)
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BYTES)
        with self._lock:
            self._close_socket()
            self._socket = sender
            self._begin()

    def detach(self) -> None:
        with self._lock:
            self._close_socket()

    @abstractmethod
    def _begin(self) -> None:
        """A new socket: nothing was sent there yet."""

    @abstractmethod
    def _turn(self) -> None:
        """Encodes and sends what is new."""

    def _run(self) -> None:
        while True:
            ends = self._stop.wait(self._period_s)
            with self._lock:
                self._turn()
            if ends:
                return

    def _send(self, datagram: bytes) -> bool:
        if self._socket is None:
            return False
        try:
            self._socket.send(datagram, socket.MSG_DONTWAIT)
            self.sent += 1
            return True
        except (BlockingIOError, InterruptedError):  # one that is slow, or does not run
            self.dropped += 1
        except OSError:  # one that is gone
            self._close_socket()
        return False

    def _close_socket(self) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
        self._socket = None
