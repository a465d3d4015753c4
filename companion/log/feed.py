"""What a page is told of the service while it flies: taken beside the recorder, sent by a thread of its own.

The control loop only counts a message, keeps the newest of its stream or appends it to a short list. Five times a
second the thread encodes what is new and sends it to the page's socket without waiting: what a page does not take is
dropped and counted. Nothing comes back.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt

from companion.config.schema import Config
from companion.core.recorder import Recorder
from companion.core.streams import (
    AUTOPILOT_EVENT,
    BEARING,
    COMMAND,
    CSI,
    GATE,
    HEALTH,
    LOG,
    MISSION,
    NEIGHBOUR,
    OBSERVED,
    POSE_IN,
    PROFILE,
    SETPOINT,
    TARGET,
    TICK,
    VEHICLE,
    WISH,
    WORKER,
    Stream,
)
from companion.log.feed_thread import FeedThread
from companion.log.lines import LogLine

PERIOD_S: Final = 0.2
INTRODUCTION, STATUS, COUNTS, END_OF_LOG = "introduction", "status", "counts", "end of log"
"""Topics of a feed beside those of the log."""
PROFILE_ROWS, PROFILE_COLUMNS = 60, 120
"""Of a profile as it is shown: three degrees a cell."""
_COUNTED: Final = frozenset(stream.topic for stream in (CSI, POSE_IN, NEIGHBOUR, SETPOINT, OBSERVED))
_NEWEST: Final = frozenset(stream.topic for stream in (VEHICLE, HEALTH, WORKER, MISSION, BEARING, TARGET, GATE))
_EACH: Final = frozenset(stream.topic for stream in (MISSION, BEARING, TARGET, GATE, WISH, COMMAND, AUTOPILOT_EVENT))
_KEPT: Final = 512
"""Messages of the streams of which each counts, between two looks of the thread."""


class Feed(FeedThread):
    """`record` and `note` belong to the event loop, `attach` and `detach` to whoever starts the page."""

    def __init__(self, introduction: Mapping[str, Any], inner: Recorder | None = None) -> None:
        super().__init__("page feed", PERIOD_S)
        self._inner = inner
        self._introduction = introduction
        self._counts = dict.fromkeys(_COUNTED, 0)
        self._newest: dict[str, tuple[int, Any] | None] = dict.fromkeys(
            (*_NEWEST, PROFILE.topic, STATUS, END_OF_LOG), None
        )
        self._each: deque[tuple[str, int, Any]] = deque(maxlen=_KEPT)
        self._t_ns = 0
        self._sent: dict[str, object] = {}

    @property
    def failed(self) -> bool:
        return self._inner is not None and self._inner.failed

    def counters(self) -> dict[str, int]:
        return {} if self._inner is None else self._inner.counters()

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """As a Recorder: for the log, and for the page."""
        if self._inner is not None:
            self._inner.record(stream, t_mono_ns, message)
        if stream.topic in self._counts:
            self._counts[stream.topic] += 1
        else:
            self.note(stream, t_mono_ns, message)

    def note(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """For the page alone."""
        topic = stream.topic
        if topic in _COUNTED:
            self._counts[topic] += 1
        elif topic == TICK.topic:
            self._t_ns = t_mono_ns
        elif topic == PROFILE.topic:
            bearing = self._newest[BEARING.topic]
            self._newest[topic] = t_mono_ns, (0 if bearing is None else bearing[1].number, message)
        else:
            if topic in _NEWEST:
                self._newest[topic] = t_mono_ns, message
            if topic in _EACH or (topic == LOG.topic and message.level >= logging.WARNING):
                self._each.append((topic, t_mono_ns, message))

    def tell(self, topic: str, t_mono_ns: int, values: Any) -> None:
        """Something that no stream holds: a status, the end of a log."""
        self._newest[topic] = t_mono_ns, values
        self._t_ns = max(self._t_ns, t_mono_ns)

    def _begin(self) -> None:
        self._sent = {}

    def _turn(self) -> None:
        if self._socket is None:
            self._each.clear()
            return
        if INTRODUCTION not in self._sent and self._tell_page(INTRODUCTION, self._t_ns, self._introduction):
            self._sent[INTRODUCTION] = True
        for _ in range(len(self._each)):
            topic, t_ns, message = self._each.popleft()
            newest = self._newest.get(topic)
            if self._tell_page(topic, t_ns, message) and newest is not None and newest[1] is message:
                self._sent[topic] = newest
        for topic, newest in self._newest.items():
            if newest is not None and self._sent.get(topic) is not newest:
                t_ns, message = newest
                if topic == PROFILE.topic:
                    message = profile_message(message[0], shrunk(_power(message[1])))
                if self._tell_page(topic, t_ns, message):
                    self._sent[topic] = newest
        self._tell_page(COUNTS, self._t_ns, dict(self._counts) | {"dropped": self.dropped})

    def _tell_page(self, topic: str, t_ns: int, message: Any) -> bool:
        return self._send(encoded(topic, t_ns, message))


def encoded(topic: str, t_ns: int, message: Any) -> bytes:
    """One datagram of a feed: JSON, with the topic, the message's own time [ns] and what it says."""
    if isinstance(message, LogLine):
        message = {"level": message.level, "text": f"{message.name}: {message.text}"}
    return msgspec.json.encode({"topic": topic, "t_ns": t_ns, "data": message})


def introduction(config: Config, source: str) -> dict[str, Any]:
    """What of a configuration its pictures need. `source` is "live" or the name of a log."""
    gate, mission = config.gate, config.mission
    return {
        "name": config.name,
        "role": config.role,
        "source": source,
        "control": mission.control,
        "peers": {str(peer.id): peer.name for peer in config.peers},
        "target": config.target,
        "fence": asdict(gate),
        "mission": asdict(mission),
        "min_reliability": config.aperture.min_reliability,
        "aperture_m": config.aperture.length_m,
        "pose_stale_s": config.pose.stale_s,
        "min_free_mib": config.recorder.min_free_mib,
        "log": str(config.path(config.recorder.path)),
    }


def profile_message(number: int, cells: npt.NDArray[np.uint8]) -> dict[str, Any]:
    """Of the profile of iteration `number`; bytes become base64 in JSON."""
    rows, columns = cells.shape
    return {"number": number, "rows": rows, "columns": columns, "cells": cells.tobytes()}


def shrunk(power: npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.uint8]:
    """A profile (180, 360) as it is shown: the greatest of each 3 x 3 cells, 255 at the peak; (60, 120)."""
    rows, columns = power.shape[0] // PROFILE_ROWS, power.shape[1] // PROFILE_COLUMNS
    blocks = power.astype(np.float32).reshape(PROFILE_ROWS, rows, PROFILE_COLUMNS, columns).max(axis=(1, 3))
    peak = float(blocks.max())
    return np.asarray(np.rint(blocks * (255 / peak if peak > 0 else 0.0)).clip(0, 255), np.uint8)


def _power(profile: bytes | npt.NDArray[np.floating[Any]]) -> npt.NDArray[np.floating[Any]]:
    if isinstance(profile, bytes):
        return np.frombuffer(profile, np.float16).reshape(180, 360)
    return profile
