"""What a log holds, stream by stream; also of a file that is cut off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from companion.core.streams import HEALTH
from companion.log.reader import LogScan, Progress
from companion.log.writer import METADATA

_HEALTH: Final = "Health"
"""Our own schema of that topic; any other robot may have one of that name."""


@dataclass(slots=True)
class TopicInfo:
    """`rate_hz` is over the topic's own time."""

    topic: str
    encoding: str
    schema: str
    messages: int = 0
    payload_bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0

    @property
    def rate_hz(self) -> float:
        span_ns = self.last_ns - self.first_ns
        return (self.messages - 1) * 1e9 / span_ns if span_ns > 0 else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """One file. `dropped` messages as the recorder last said in health."""

    path: Path
    size_bytes: int
    is_whole: bool
    damaged: int
    """Places that could not be read, though the file goes on behind them."""
    another_at: int | None
    """Where another log begins in the file; only the first is told of."""
    metadata: Mapping[str, str]
    topics: tuple[TopicInfo, ...]
    start_ns: int
    end_ns: int
    dropped: int

    @property
    def duration_s(self) -> float:
        return (self.end_ns - self.start_ns) / 1e9


def inspect(path: Path, progress: Progress | None = None) -> LogInfo:
    """Raises CompanionError for what is no log."""
    scan = LogScan(path, progress=progress)
    topics: dict[tuple[str, str, str], TopicInfo] = {}
    dropped = 0
    for message in scan:
        key = (message.topic, message.encoding, message.schema[0])
        info = topics.get(key)
        if info is None:
            info = topics[key] = TopicInfo(message.topic, message.encoding, message.schema[0])
            info.first_ns = message.log_time_ns
        info.messages += 1
        info.payload_bytes += len(message.data)
        info.first_ns = min(info.first_ns, message.log_time_ns)
        info.last_ns = max(info.last_ns, message.log_time_ns)
        if message.topic == HEALTH.topic and message.encoding == HEALTH.encoding and message.schema[0] == _HEALTH:
            dropped = dropped_of(message.data, dropped)
    return LogInfo(
        path=path,
        size_bytes=scan.size_bytes,
        is_whole=scan.is_whole,
        damaged=scan.damaged,
        another_at=scan.another_at,
        metadata=scan.metadata.get(METADATA, {}),
        topics=tuple(topics[topic] for topic in sorted(topics)),
        start_ns=min((info.first_ns for info in topics.values()), default=0),
        end_ns=max((info.last_ns for info in topics.values()), default=0),
        dropped=dropped,
    )


def dropped_of(health: bytes, otherwise: int) -> int:
    """Messages the recorder had dropped, as a message of our health says."""
    try:
        return msgspec.json.decode(health, type=_Health).recorder.dropped
    except (msgspec.MsgspecError, RecursionError):
        return otherwise


class _Recorder(msgspec.Struct):
    dropped: int = 0


class _Health(msgspec.Struct):
    recorder: _Recorder = msgspec.field(default_factory=_Recorder)
