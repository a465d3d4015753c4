"""What a replay gives: the decisions made again, as messages, as a log and as plain values."""

from __future__ import annotations

import hashlib
import itertools
import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from companion.clock import NS_PER_S
from companion.config import Config
from companion.errors import CompanionError
from companion.log.encoding import schema_of
from companion.log.writer import LogWriter
from companion.log_reader import LoggedMessage, LogScan, Progress, Session
from companion.replay.player import INPUT_TOPICS, Decided, Player
from companion.streams import HEALTH


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """`decided` in the order of decision. `unexpected` counts outcomes and answers that nothing had asked for."""

    decided: list[Decided]
    events: int
    flight_s: float
    unexpected: int
    dropped_while_recording: int

    def as_json(self) -> dict[str, Any]:
        """The same for each replay of one log."""
        counts = Counter(decided.stream.topic for decided in self.decided)
        digest = hashlib.sha256()
        for decided in self.decided:
            digest.update(decided.stream.topic.encode() + decided.event.to_bytes(8, "little") + decided.data)
        return {
            "events": self.events,
            "flight_s": self.flight_s,
            "unexpected": self.unexpected,
            "dropped_while_recording": self.dropped_while_recording,
            "messages": dict(sorted(counts.items())),
            "sha256": digest.hexdigest(),
        }


def replay_log(player: Player, session: Session, speed: float | None, progress: Progress | None = None) -> ReplayResult:
    """The whole log, paced if `speed` says so. Raises CompanionError for a log without events."""
    return collect(player, session, paced(player.events(progress), speed))


def paced(events: Iterable[Any], speed: float | None) -> Iterator[Any]:
    """The events, each not before its time."""
    begun, first_ns = time.monotonic(), None
    for event in events:
        if speed is not None:
            first_ns = event.t_ns if first_ns is None else first_ns
            time.sleep(max(0.0, begun + (event.t_ns - first_ns) / NS_PER_S / speed - time.monotonic()))
        yield event


def collect(player: Player, session: Session, events: Iterable[Any]) -> ReplayResult:
    """Runs the events out. The last event of a log that was cut off may lack its end: it is left out."""
    last = last_event(session)
    count, first_ns, end_ns = 0, None, 0
    for event in events:
        if last is not None and event.number >= last:
            break
        first_ns = event.t_ns if first_ns is None else first_ns
        end_ns, count = event.t_ns, count + 1
    if first_ns is None:
        raise CompanionError(f"{session.paths[0]}: holds no input of the service; nothing to replay")
    decided = [one for one in player.log.decided if last is None or one.event < last]
    unexpected = player.commands.unexpected + player.worker.unexpected
    return ReplayResult(decided, count, (end_ns - first_ns) / NS_PER_S, unexpected, _dropped(session))


def complete(messages: Iterable[LoggedMessage], last: int | None) -> Iterator[LoggedMessage]:
    """Those before the event at which a log was cut off."""
    return itertools.takewhile(lambda message: last is None or message.sequence < last, messages)


def last_event(session: Session) -> int | None:
    """The number of the last event of a log that is cut off, None for a whole one."""
    scan = LogScan(session.paths[-1])
    last = None
    for message in scan:
        last = message.sequence
    return None if scan.is_whole else last


def start_ns_of(session: Session) -> int:
    """Wall time of the first event."""
    return next((message.log_time_ns for message in session.messages(INPUT_TOPICS)), 0)


def write_log(path: Path, session: Session, config: Config, result: ReplayResult) -> None:
    """What the replay decided, as a log of its own. Raises OSError."""
    metadata = dict(session.metadata) | {"role": "replay", "config": json.dumps(msgspec.to_builtins(config))}
    offset_ns = session.wall_minus_mono_ns
    with path.open("wb") as file:
        writer = LogWriter(file, metadata)
        for one in result.decided:
            times = (one.t_ns + offset_ns, one.own_t_ns + offset_ns)
            schema = schema_of(one.source)
            writer.copy(one.stream.topic, one.stream.encoding, schema, times, one.event & 0xFFFFFFFF, one.data)
        writer.finish()


def _dropped(session: Session) -> int:
    dropped = 0
    for message in session.messages({HEALTH.topic}):
        dropped = msgspec.json.decode(message.data)["recorder"].get("dropped", 0)
    return int(dropped)
