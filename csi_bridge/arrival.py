"""When a datagram arrived, by the kernel's stamp: it is the same whenever the datagram is read.

The kernel stamps with its wall clock (SO_TIMESTAMPNS of socket(7)); what is given is monotonic. Sockets of UDP and of
Unix are stamped, those of netlink are not. It begins to stamp a moment after the host's first socket asked for it; what
came before has the time of its reading.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable
from typing import Any, Final

_SO_TIMESTAMPNS: Final = 35
"""Of Linux's generic sockets, which all processors have that we run on; SCM_TIMESTAMPNS is the same number."""
_TIMESPEC: Final = struct.Struct("@qq")
_TOGETHER_NS: Final = 50_000
_TRIES: Final = 5
_ANCILLARY_BYTES: Final = socket.CMSG_SPACE(_TIMESPEC.size)


class StampedSocket:
    """Reads a socket that does not block. The socket stays the caller's."""

    def __init__(
        self,
        opened: socket.socket,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        opened.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket = opened
        self._monotonic_ns = monotonic_ns
        self._wall_ns = wall_ns
        self._empty_ns = monotonic_ns()
        """All that waits arrived after this."""

    def receive(self, size: int) -> tuple[bytes, Any, int | None]:
        """A datagram, its sender, and when it arrived (CLOCK_MONOTONIC [ns]): not before it did, and not after this
        call. None where the kernel does not say, or its wall clock was set meanwhile. Raises OSError as a socket does,
        BlockingIOError where nothing waits."""
        asked_ns = self._monotonic_ns()
        try:
            data, ancillary, _, sender = self._socket.recvmsg(size, _ANCILLARY_BYTES)
        except BlockingIOError:
            self._empty_ns = asked_ns
            raise
        return data, sender, self._arrived_ns(ancillary)

    def _arrived_ns(self, ancillary: list[tuple[int, int, bytes]]) -> int | None:
        for level, kind, content in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(content) >= _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack_from(content)
                now_ns, wall_ns = self._both()
                waited_ns = wall_ns - (seconds * 1_000_000_000 + nanoseconds)
                return now_ns - waited_ns if 0 <= waited_ns <= now_ns - self._empty_ns else None
        return None

    def _both(self) -> tuple[int, int]:
        """Monotonic and wall time of one moment, the former late by no more than `_TOGETHER_NS` but where a saturated
        host holds this thread up at each of a few tries."""
        tightest: tuple[int, int, int] | None = None
        for _ in range(_TRIES):
            before_ns, wall_ns, after_ns = self._monotonic_ns(), self._wall_ns(), self._monotonic_ns()
            if tightest is None or after_ns - before_ns < tightest[0]:
                tightest = after_ns - before_ns, after_ns, wall_ns
            if tightest[0] <= _TOGETHER_NS:
                break
        assert tightest is not None
        return tightest[1:]
