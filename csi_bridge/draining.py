"""Datagrams that wait in a socket, as records: the same for every source."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from typing import Any, Final

from csi_bridge.arrival import StampedSocket
from csi_bridge.records import CsiError
from csi_bridge.source import SourceCounters

_DATAGRAM_BYTES: Final = 1 << 16
Decode = Callable[[bytes, Any], tuple[int, bytes] | None]
"""(code, body) of a datagram of this sender; None where the sender is not to be believed. Raises CsiError."""


class Draining:
    """A CsiSource: reads a socket that does not block, and counts."""

    def __init__(self, opened: socket.socket, decode: Decode, is_stamped: bool = False) -> None:
        """`is_stamped`: a socket whose datagrams the kernel stamps."""
        self._socket = opened
        self._stamped = StampedSocket(opened) if is_stamped else None
        self._decode = decode
        self._counters = SourceCounters()
        self._gathered: list[tuple[bytes, Any, int | None]] = []

    @property
    def counters(self) -> SourceCounters:
        return self._counters

    @property
    def is_stamped(self) -> bool:
        return self._stamped is not None

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()

    def drain(self, limit: int = 256) -> list[tuple[int, bytes]]:
        """As `arrivals`, without their times."""
        return [(code, body) for code, body, _ in self.arrivals(limit)]

    def gather(self, limit: int = 256) -> int:
        """See CsiSource. ENOBUFS means records were lost and the socket is fine: counted, reading goes on."""
        before = len(self._gathered)
        for _ in range(limit):
            try:
                self._gathered.append(self._receive())
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno != errno.ENOBUFS:
                    raise
                self._counters.overruns += 1
        return len(self._gathered) - before

    def arrivals(self, limit: int = 256) -> list[tuple[int, bytes, int | None]]:
        """See CsiSource."""
        self.gather(limit)
        gathered, self._gathered = self._gathered, []
        records: list[tuple[int, bytes, int | None]] = []
        for datagram, sender, arrived_ns in gathered:
            record = self._counted(datagram, sender)
            if record is not None:
                records.append((record[0], record[1], arrived_ns))
        return records

    def _receive(self) -> tuple[bytes, Any, int | None]:
        if self._stamped is not None:
            return self._stamped.receive(_DATAGRAM_BYTES)
        return *self._socket.recvfrom(_DATAGRAM_BYTES), None

    def _counted(self, datagram: bytes, sender: Any) -> tuple[int, bytes] | None:
        self._counters.datagrams += 1
        try:
            record = self._decode(datagram, sender)
        except CsiError:
            self._counters.malformed += 1
            return None
        if record is None:
            self._counters.refused_sender += 1
        return record
