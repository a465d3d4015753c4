"""What a live server is fed: each channel announced once, only what is subscribed to, and the newest state at once."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec
import pytest

from companion.core.event_clock import EventClock
from companion.core.messages import Pose, VehicleState
from companion.core.streams import CSI, MISSION, POSE, SCENE, TRANSFORMS, VEHICLE, Stream
from companion.log.encoding import encoded, schema_of
from companion.log.live import ANNOUNCEMENT, MESSAGE, Announced, LiveFeed
from tests.kept import Kept
from tests.manual_clock import ManualClock

_POSE = Pose(
    t_mono_ns=7, p_enu_m=(1.0, 2.0, 3.0), q_enu_from_body=(1.0, 0.0, 0.0, 0.0), v_enu_m_s=(0.0, 0.0, 0.0), confidence=3
)
_VEHICLE = VehicleState(t_mono_ns=7, p_local_enu_m=(1.0, 2.0, 1.5), yaw_enu_rad=0.3)


@dataclass
class _Fed:
    """A feed whose thread is turned by hand, and the server's end of its socket."""

    feed: LiveFeed
    log: Kept
    end: socket.socket
    channels: dict[int, Announced] = field(default_factory=dict)

    def subscribe(self, *streams: Stream) -> None:
        self.end.send(msgspec.json.encode([stream.topic for stream in streams]))

    def turned(self) -> list[tuple[str, bytes]]:
        """(topic, bytes) of the messages that a turn sends; announcements are kept."""
        self.feed._turn()
        found = list[tuple[str, bytes]]()
        while True:
            try:
                data = self.end.recv(1 << 20, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return found
            number, _ = MESSAGE.unpack_from(data)
            body = data[MESSAGE.size :]
            if number == ANNOUNCEMENT:
                told = msgspec.msgpack.decode(body, type=Announced)
                assert told.number not in self.channels, "announced twice"
                self.channels[told.number] = told
            else:
                found.append((self.channels[number].topic, body))


@pytest.fixture
def fed() -> Iterator[_Fed]:
    log = Kept()
    feed = LiveFeed(log, EventClock(ManualClock(1_000)))
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    feed.attach(ours)
    yield _Fed(feed, log, theirs)
    feed.close()
    theirs.close()


def test_a_channel_is_announced_with_the_logs_own_schema_and_then_silent(fed: _Fed) -> None:
    fed.feed.record(VEHICLE, 7, _VEHICLE)
    assert fed.turned() == []
    fed.feed.record(VEHICLE, 7, _VEHICLE)
    assert fed.turned() == []
    told = next(one for one in fed.channels.values() if one.topic == VEHICLE.topic)
    assert (told.encoding, (told.schema_name, told.schema_encoding, told.schema)) == ("json", schema_of(_VEHICLE))
    assert fed.log.topics == [VEHICLE.topic] * 2, "the log has everything"
    assert fed.feed.counters() == {"written": 2}


def test_only_what_is_subscribed_to_is_sent_as_the_log_has_it(fed: _Fed) -> None:
    for stream, message in ((VEHICLE, _VEHICLE), (CSI, b"\xbb")):
        fed.feed.record(stream, 7, message)
    fed.turned()
    fed.subscribe(VEHICLE)
    fed.turned()
    fed.feed.record(CSI, 8, b"\xbb")
    fed.feed.record(VEHICLE, 8, _VEHICLE)
    assert fed.turned() == [(VEHICLE.topic, encoded(VEHICLE, 8, _VEHICLE)[0])]


def test_a_view_is_drawn_though_what_it_is_drawn_from_is_not_subscribed_to(fed: _Fed) -> None:
    fed.feed.record(POSE, 7, _POSE)
    fed.feed.record(VEHICLE, 7, _VEHICLE)
    fed.turned()
    fed.subscribe(TRANSFORMS)
    fed.turned()
    fed.feed.record(VEHICLE, 8, _VEHICLE)
    assert [topic for topic, _ in fed.turned()] == [TRANSFORMS.topic]


def test_the_missions_state_is_told_to_who_comes_later(fed: _Fed) -> None:
    fed.feed.record(MISSION, 7, {"state": "idle"})
    fed.turned()
    fed.subscribe(MISSION)
    assert fed.turned() == [(MISSION.topic, b'{"state":"idle"}')]
    assert fed.turned() == []


def test_a_message_that_cannot_be_encoded_costs_only_itself(fed: _Fed) -> None:
    fed.subscribe(MISSION)
    fed.turned()
    fed.feed.record(MISSION, 7, object())
    fed.feed.record(MISSION, 8, {"state": "holding"})
    assert fed.turned() == [(MISSION.topic, b'{"state":"holding"}')]
    assert fed.feed.dropped == 1


def test_without_a_server_nothing_is_kept() -> None:
    feed = LiveFeed(Kept(), EventClock(ManualClock(1_000)))
    feed.record(VEHICLE, 7, _VEHICLE)
    feed._turn()
    assert not feed._kept
    assert SCENE.topic not in feed._wanted
