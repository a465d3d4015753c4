"""What viewers are sent of the log while it is written: encoded by a thread, and only what somebody subscribes to.

The control loop looks into a set and keeps a reference. Twenty times a second the thread encodes what was kept as the
log's writer does, and sends it to the server's process without waiting: what is not taken is dropped and counted. Back
comes which topics are subscribed to.
"""

from __future__ import annotations

import contextlib
import struct
import time
from collections import deque
from collections.abc import Iterator
from typing import Any, Final

import msgspec

from companion.core.event_clock import EventClock
from companion.core.messages import Pose
from companion.core.recorder import Recorder
from companion.core.streams import (
    APERTURE,
    APERTURE_PATH,
    BEARING,
    POSE,
    SCENE,
    STREAMS,
    TARGET,
    TRANSFORMS,
    TRUTH,
    VEHICLE,
    Stream,
)
from companion.log.encoding import encoded, schema_of, views
from companion.log.feed_thread import FeedThread

PERIOD_S: Final = 0.05
MESSAGE: Final = struct.Struct("<Hq")
"""Before the bytes of a message: number of its channel, log time [ns]. A datagram without it is an announcement."""
ANNOUNCEMENT: Final = 0xFFFF
_KEPT: Final = 2000
_CONTROL_BYTES: Final = 65536
_DRAWN_FROM: Final = {
    TRANSFORMS.topic: frozenset({VEHICLE.topic, POSE.topic}),
    APERTURE_PATH.topic: frozenset({APERTURE.topic}),
    SCENE.topic: frozenset({BEARING.topic, TARGET.topic}),
}
_ALL: Final = frozenset(stream.topic for stream in STREAMS) - {TRUTH.topic}
_NOT_ENCODED: Final = (
    ValueError, TypeError, ArithmeticError, LookupError, AttributeError, struct.error, msgspec.MsgspecError
)  # fmt: skip


class Announced(msgspec.Struct, frozen=True, kw_only=True):
    """A channel that there is from now on."""

    number: int
    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class LiveFeed(FeedThread):
    """`record` belongs to the event loop, `attach` and `detach` to whoever starts the server."""

    def __init__(self, inner: Recorder, clock: EventClock) -> None:
        super().__init__("live feed", PERIOD_S)
        self._inner = inner
        self._clock = clock
        self._wall_minus_mono_ns = time.time_ns() - time.monotonic_ns()
        self._kept: deque[tuple[Stream, int, int, Any]] = deque(maxlen=_KEPT)
        self._newest: dict[str, tuple[Stream, int, int, Any]] = {}
        """Of streams without a rate, such as the mission's state: who comes later is told it too."""
        self._wanted: frozenset[str] = frozenset()
        """Topics of which messages are kept: replaced as a whole, by the thread."""
        self._subscribed: frozenset[str] = frozenset()
        self._channels: dict[str, int] = {}
        self._pose: Pose | None = None

    @property
    def failed(self) -> bool:
        return self._inner.failed

    def counters(self) -> dict[str, int]:
        return self._inner.counters()

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """As a Recorder: for the log, and for viewers."""
        self._inner.record(stream, t_mono_ns, message)
        if stream.topic in self._wanted or not stream.rate_hz:
            one = stream, self._clock.now_ns(), t_mono_ns, message
            self._kept.append(one)
            if not stream.rate_hz:
                self._newest[stream.topic] = one

    def _begin(self) -> None:
        self._subscribed, self._channels = frozenset(), {}
        self._kept.extend(list(self._newest.values()))
        self._choose()

    def _turn(self) -> None:
        self._hear()
        self._send_kept()

    def _hear(self) -> None:
        """The newest that the server says of its subscribers."""
        told = b""
        with contextlib.suppress(BlockingIOError, OSError):
            while self._socket is not None and (data := self._socket.recv(_CONTROL_BYTES)):
                told = data
        if told:
            before, self._subscribed = self._subscribed, frozenset(msgspec.json.decode(told, type=list[str]))
            self._kept.extend(one for one in list(self._newest.values()) if one[0].topic in self._subscribed - before)
            self._choose()

    def _choose(self) -> None:
        """What is subscribed to, what is not announced yet, and what either is drawn from."""
        shown = self._subscribed | (_ALL - self._channels.keys())
        if self._socket is None:
            shown = frozenset()
        self._wanted = shown.union(*(_DRAWN_FROM[topic] for topic in shown & _DRAWN_FROM.keys()))

    def _send_kept(self) -> None:
        if self._socket is None:
            self._kept.clear()
            return
        known = len(self._channels)
        for _ in range(len(self._kept)):
            stream, log_ns, own_ns, message = self._kept.popleft()
            try:
                for one, log_t_ns, data, source in self._encoded(stream, log_ns, own_ns, message):
                    self._send_one(one, log_t_ns, data, source)
            except _NOT_ENCODED:  # the log's writer says so
                self.dropped += 1
        if len(self._channels) != known:
            self._choose()

    def _encoded(
        self, stream: Stream, log_ns: int, own_ns: int, message: Any
    ) -> Iterator[tuple[Stream, int, bytes, Any]]:
        """A message and the views drawn from it, as `companion.log.writer` has them."""
        log_t_ns, own_t_ns = log_ns + self._wall_minus_mono_ns, own_ns + self._wall_minus_mono_ns
        if isinstance(message, Pose):
            self._pose = message
        if self._is_shown(stream):
            yield stream, log_t_ns, *encoded(stream, own_t_ns, message)
        for view, drawn in views(stream, own_t_ns, message, self._pose):
            if self._is_shown(view):
                yield view, log_t_ns, *encoded(view, own_t_ns, drawn)

    def _is_shown(self, stream: Stream) -> bool:
        return stream.topic in self._subscribed or stream.topic not in self._channels

    def _send_one(self, stream: Stream, log_t_ns: int, data: bytes, source: Any) -> None:
        number = self._channels.get(stream.topic)
        if number is None:
            name, kind, schema = schema_of(source)
            number = len(self._channels)
            told = Announced(
                number=number, topic=stream.topic, encoding=stream.encoding, schema_name=name, schema_encoding=kind,
                schema=schema,
            )  # fmt: skip
            if not self._send(MESSAGE.pack(ANNOUNCEMENT, 0) + msgspec.msgpack.encode(told)):
                return
            self._channels[stream.topic] = number
        if stream.topic in self._subscribed:
            self._send(MESSAGE.pack(number, log_t_ns) + data)

    def _close_socket(self) -> None:
        super()._close_socket()
        self._wanted = frozenset()
