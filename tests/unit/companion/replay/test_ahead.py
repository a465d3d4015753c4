"""Reading ahead changes neither what is read nor its order."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from companion.log.reader import LoggedMessage
from companion.replay import ahead
from companion.replay.ahead import ReadAhead


def _messages(count: int) -> list[LoggedMessage]:
    return [
        LoggedMessage(topic="/csi", log_time_ns=n, data=b"", publish_time_ns=n, sequence=n) for n in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("filled_every", [1, 3, 1000])
def test_the_same_messages_come_in_the_same_order(filled_every: int) -> None:
    messages = _messages(500)
    read = ReadAhead(messages)
    found = []
    for number, message in enumerate(read):
        found.append(message)
        if number % filled_every == 0:
            read.fill()
    assert found == messages


def test_it_says_when_there_is_nothing_more_to_read_or_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "_MOST", 128)
    read = ReadAhead(_messages(200))
    assert [read.fill() for _ in range(4)] == [True, True, False, False]
    assert sum(1 for _ in read) == 200
    assert not ReadAhead([]).fill()


def test_nothing_is_read_before_somebody_asks() -> None:
    taken: list[int] = []

    def source() -> Iterator[LoggedMessage]:
        for message in _messages(100):
            taken.append(message.sequence)
            yield message

    read = ReadAhead(source())
    assert taken == []
    next(read)
    assert taken == [0]
    read.fill()
    assert len(taken) == 65
