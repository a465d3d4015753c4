"""What waits in a socket, as records: counted, limited, and with the time it came where that is known."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from csi_bridge.draining import Draining
from csi_bridge.records import CsiError
from csi_bridge.source import SourceCounters


def _decode(datagram: bytes, sender: Any) -> tuple[int, bytes] | None:
    if datagram == b"garbage":
        raise CsiError("no record")
    return None if datagram == b"stranger" else (datagram[0], datagram[1:])


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    reads, sends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    reads.setblocking(False)
    with reads, sends:
        yield reads, sends


def test_what_is_no_record_or_of_a_stranger_is_counted_and_not_given(ends: tuple[socket.socket, ...]) -> None:
    reads, sends = ends
    source = Draining(reads, _decode)
    for datagram in (b"\x01a", b"garbage", b"stranger", b"\x02b"):
        sends.send(datagram)
    assert source.arrivals() == [(1, b"a", None), (2, b"b", None)]
    assert source.counters == SourceCounters(datagrams=4, malformed=1, refused_sender=1)
    assert source.arrivals() == []


def test_what_was_gathered_is_given_later_once(ends: tuple[socket.socket, ...]) -> None:
    reads, sends = ends
    source = Draining(reads, _decode)
    for number in range(5):
        sends.send(bytes([number]))
    assert source.gather(limit=2) == 2
    assert source.counters.datagrams == 0, "what is gathered is not looked at yet"
    assert [code for code, _ in source.drain(limit=1)] == [0, 1, 2]
    assert [code for code, _ in source.drain()] == [3, 4]
    assert source.drain() == []


def test_stamped_sockets_tell_when_each_record_came(ends: tuple[socket.socket, ...]) -> None:
    reads, sends = ends
    source = Draining(reads, _decode, is_stamped=True)
    assert source.is_stamped
    sends.send(b"\x01a")
    sends.send(b"\x02b")
    (_, _, first_ns), (_, _, second_ns) = source.arrivals()
    assert first_ns is not None
    assert second_ns is not None
    assert first_ns <= second_ns


class _Failing:
    """A socket whose next receptions end so."""

    def __init__(self, *ends: object) -> None:
        self._ends = list(ends)

    def recvfrom(self, size: int) -> tuple[bytes, object]:
        if not self._ends:
            raise BlockingIOError
        end = self._ends.pop(0)
        if isinstance(end, OSError):
            raise end
        assert isinstance(end, bytes)
        return end, None


def test_records_that_the_kernel_dropped_are_counted_and_reading_goes_on() -> None:
    lost = OSError(errno.ENOBUFS, "No buffer space available")
    source = Draining(_Failing(lost, b"\x01a", lost, b"\x02b"), _decode)  # type: ignore[arg-type]
    assert source.drain() == [(1, b"a"), (2, b"b")]
    assert source.counters == SourceCounters(datagrams=2, overruns=2)


def test_any_other_error_of_the_socket_is_raised() -> None:
    gone = OSError(errno.EBADF, "Bad file descriptor")
    with pytest.raises(OSError, match="Bad file descriptor"):
        Draining(_Failing(gone), _decode).drain()  # type: ignore[arg-type]
