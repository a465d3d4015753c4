"""A thread that feeds a process and never waits for it."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Iterator

import pytest

from companion.log.feed_thread import FeedThread


class _Feed(FeedThread):
    """Sends what stands in `waiting`, each time a socket begins anew after a greeting."""

    def __init__(self) -> None:
        super().__init__("feed", 0.005)
        self.waiting: deque[bytes] = deque()

    def _begin(self) -> None:
        self._send(b"hello")

    def _turn(self) -> None:
        while self.waiting:
            self._send(self.waiting.popleft())


def _pair() -> tuple[socket.socket, socket.socket]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.settimeout(30)
    return ours, theirs


@pytest.fixture
def feed() -> Iterator[_Feed]:
    made = _Feed()
    made.start()
    yield made
    made.close()
    made.close()  # harmless when repeated


def test_each_reader_is_greeted_and_told_from_then_on(feed: _Feed) -> None:
    ours, theirs = _pair()
    feed.attach(ours)
    feed.waiting.append(b"one")
    assert [theirs.recv(64), theirs.recv(64)] == [b"hello", b"one"]
    again, next_one = _pair()
    feed.attach(again)
    assert theirs.recv(64) == b"", "the one before is let go"
    assert next_one.recv(64) == b"hello"
    theirs.close()
    next_one.close()


def test_what_is_left_is_sent_before_the_end() -> None:
    feed = _Feed()
    ours, theirs = _pair()
    feed.attach(ours)
    feed.waiting.append(b"last")
    feed.start()
    feed.close()
    assert [theirs.recv(64), theirs.recv(64), theirs.recv(64)] == [b"hello", b"last", b""]
    theirs.close()


def test_a_reader_that_does_not_read_costs_messages_and_one_that_is_gone_none() -> None:
    feed = _Feed()
    ours, theirs = _pair()
    feed.attach(ours)
    sent = sum(feed._send(bytes(60_000)) for _ in range(200))
    assert 0 < sent < 200
    assert feed.dropped == 200 - sent
    assert feed.sent == sent + 1
    theirs.close()
    assert not feed._send(b"nobody")
    assert feed.dropped == 200 - sent, "who is not there misses nothing"
    feed.detach()
    assert not feed._send(b"nobody")
