"""The feed of a page: waits for nobody, tells the newest, counts what was not taken, begins anew for a new page."""

from __future__ import annotations

import json
import logging
import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from companion.core.inputs import Tick
from companion.core.messages import VehicleState
from companion.core.streams import BEARING, CSI, HEALTH, LOG, PROFILE, TICK, VEHICLE
from companion.log.feed import Feed, encoded, profile_message, shrunk
from companion.log.lines import LogLine
from companion.log.records import LoggedIteration

_PATIENCE_S = 60.0
_Message = dict[str, Any]


class Reader:
    """The page's end: reads when it is told to."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._end.settimeout(_PATIENCE_S)

    def until(self, topic: str, is_so: Any = lambda message: True) -> _Message:
        while True:
            message: _Message = json.loads(self._end.recv(1 << 20))
            if message["topic"] == topic and is_so(message):
                return message


@pytest.fixture
def feed() -> Iterator[Feed]:
    feed = Feed({"name": "uav"})
    feed.start()
    yield feed
    feed.close()


def attached(feed: Feed) -> tuple[Reader, socket.socket]:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    feed.attach(ours)
    return Reader(theirs), theirs


def iteration(number: int) -> LoggedIteration:
    return LoggedIteration(
        number=number, peer=2, start_ns=0, end_ns=1, reference_ns=1, received=1, estimate=None, refusal="few"
    )


def test_a_page_is_introduced_and_told_the_newest(feed: Feed) -> None:
    for k in range(100):
        feed.note(VEHICLE, k, VehicleState(t_mono_ns=k))
    reader, end = attached(feed)
    with end:
        assert reader.until("introduction")["data"] == {"name": "uav"}
        assert reader.until("/vehicle")["data"]["t_mono_ns"] == 99


def test_streams_are_counted_by_the_services_own_clock(feed: Feed) -> None:
    reader, end = attached(feed)
    with end:
        for _ in range(7):
            feed.note(CSI, 5, b"")
        feed.note(TICK, 1_000, Tick(1_000))
        told = reader.until("counts", lambda message: message["data"]["/csi"] == 7 and message["t_ns"] == 1_000)
        assert told["data"]["/setpoint"] == 0


def test_a_profile_goes_with_its_iteration_and_small(feed: Feed) -> None:
    reader, end = attached(feed)
    with end:
        power = np.zeros((180, 360), np.float16)
        power[90, 180] = 0.5
        feed.note(BEARING, 5, iteration(8))
        feed.note(PROFILE, 5, power.tobytes())
        told = reader.until("/aoa/profile")["data"]
        assert (told["number"], told["rows"], told["columns"]) == (8, 60, 120)


def test_warnings_of_the_log_are_told_and_the_rest_is_not(feed: Feed) -> None:
    reader, end = attached(feed)
    with end:
        feed.note(LOG, 5, LogLine(logging.INFO, "companion", "fine"))
        feed.note(LOG, 6, LogLine(logging.WARNING, "companion", "not fine"))
        assert reader.until("/log")["data"]["text"] == "companion: not fine"


def test_a_page_that_reads_nothing_costs_messages_and_no_time(feed: Feed) -> None:
    """The page is stopped: its socket fills, and the service goes on."""
    _, end = attached(feed)
    with end:
        deadline_s = time.monotonic() + _PATIENCE_S
        while not feed.dropped:
            feed.note(BEARING, 5, iteration(1))
            feed.note(PROFILE, 5, np.ones((180, 360), np.float16).tobytes())
            assert time.monotonic() < deadline_s
        before = feed.dropped
        for k in range(2000):  # none of these calls touches the socket
            feed.note(HEALTH, k, {"k": k})
        assert feed.dropped >= before


def test_a_page_that_is_gone_is_forgotten_and_the_next_is_told_all(feed: Feed) -> None:
    reader, end = attached(feed)
    feed.note(BEARING, 5, iteration(3))
    reader.until("/bearing")
    end.close()
    feed.note(VEHICLE, 6, VehicleState(t_mono_ns=6))
    reader, end = attached(feed)
    with end:
        reader.until("introduction")
        assert {reader.until("/bearing")["data"]["number"], 3} == {3}


def test_recording_goes_on_to_the_log() -> None:
    class Kept:
        failed = True

        def __init__(self) -> None:
            self.messages: list[Any] = []

        def record(self, stream: Any, t_mono_ns: int, message: Any) -> None:
            self.messages.append((stream, t_mono_ns, message))

        def counters(self) -> dict[str, int]:
            return {"written": 4}

    kept = Kept()
    feed = Feed({}, kept)
    feed.record(CSI, 7, b"x")
    assert kept.messages == [(CSI, 7, b"x")]
    assert feed.failed and feed.counters() == {"written": 4}


def test_a_shrunk_profile_keeps_its_peak() -> None:
    power = np.zeros((180, 360))
    power[10, 20] = 3.0
    cells = shrunk(power)
    assert cells.shape == (60, 120) and cells[3, 6] == 255 and cells.sum() == 255
    assert shrunk(np.zeros((180, 360))).max() == 0
    assert json.loads(encoded("/aoa/profile", 1, profile_message(2, cells)))["data"]["number"] == 2
