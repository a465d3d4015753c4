"""What a replay gives: the decisions made again, as messages, as a log and as plain values."""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from companion.config.schema import Config
from companion.core.clock import NS_PER_S
from companion.core.streams import HEALTH
from companion.errors import CompanionError
from companion.host.whole_file import whole_file
from companion.log.encoding import schema_of
from companion.log.info import dropped_of
from companion.log.reader import LoggedMessage, Progress, Session
from companion.log.writer import LogWriter
from companion.replay.player import DECISION_TOPICS, INPUT_TOPICS, Decided, InputEvent, Player

_LONGEST_WAIT_S = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayResult:
    """Both sides in the order of decision. `unexpected` counts outcomes and answers that nothing had asked for."""

    recorded: list[LoggedMessage]
    decided: list[Decided]
    events: int
    start_ns: int
    """Monotonic time of the first event."""
    flight_s: float
    unexpected: int
    dropped_while_recording: int
    is_cut: bool
    """Whether the log ended before its time: cut off, or damaged from there on."""

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
            "is_cut": self.is_cut,
            "messages": dict(sorted(counts.items())),
            "sha256": digest.hexdigest(),
        }


class Replay:
    """One pass over a log: its events through the player, its recorded decisions kept for comparison."""

    def __init__(
        self,
        player: Player,
        session: Session,
        progress: Progress | None = None,
        on_health: Callable[[LoggedMessage], None] = lambda message: None,
    ) -> None:
        """`on_health` is told what the log says of its own health, once a second."""
        self._player = player
        self._session = session
        self._progress = progress
        self._on_health = on_health
        self._recorded: list[LoggedMessage] = []
        self._last = 0
        self._is_cut = False
        self._dropped = 0
        self._events = 0
        self._start_ns = 0
        self._end_ns = 0

    def events(self) -> Iterator[InputEvent]:
        """Handles and yields one event after the other. Raises CompanionError for a log without any."""
        for event in self._player.events(self._messages()):
            self._start_ns = self._start_ns or event.t_ns
            self._end_ns = event.t_ns
            self._events += 1
            yield event
        if not self._events:
            where = "before its first damaged place or its end" if self._is_cut else "of the service"
            raise CompanionError(f"{self._session.paths[0]}: holds no input {where}; nothing to replay")

    def result(self) -> ReplayResult:
        """After the last event. That of a log that was cut off may lack its end: what it decided is left out."""
        end = self._last if self._is_cut else self._last + 1
        player = self._player
        return ReplayResult(
            recorded=[message for message in self._recorded if message.sequence < end],
            decided=[one for one in player.log.decided if one.event < end],
            events=self._events,
            start_ns=self._start_ns,
            flight_s=(self._end_ns - self._start_ns) / NS_PER_S,
            unexpected=player.unexpected,
            dropped_while_recording=self._dropped,
            is_cut=self._is_cut,
        )

    def _messages(self) -> Iterator[LoggedMessage]:
        topics = INPUT_TOPICS | DECISION_TOPICS | {HEALTH.topic}
        # Behind a damaged place inputs are missing, and all that follows from them would differ.
        for message in self._session.messages(topics, self._progress, self._note_cut, past_damage=False):
            self._last = message.sequence
            if message.topic in DECISION_TOPICS:
                self._recorded.append(message)
            elif message.topic == HEALTH.topic:
                self._dropped = dropped_of(message.data, self._dropped)
                self._on_health(message)
            yield message

    def _note_cut(self, path: Path) -> None:
        self._is_cut = True


def replay_log(player: Player, session: Session, speed: float | None, progress: Progress | None = None) -> ReplayResult:
    """The whole log, paced if `speed` says so. Raises CompanionError for a log without events."""
    replay = Replay(player, session, progress)
    begun = time.monotonic()
    first_ns = None
    for event in replay.events():
        if speed is not None:
            first_ns = event.t_ns if first_ns is None else first_ns
            wait_s = begun + (event.t_ns - first_ns) / NS_PER_S / speed - time.monotonic()
            if wait_s > _LONGEST_WAIT_S:  # a time that jumped: the rest is paced from there
                first_ns, begun = event.t_ns, time.monotonic()
                wait_s = 0.0
            time.sleep(max(0.0, wait_s))
    return replay.result()


def write_log(path: Path, session: Session, config: Config, result: ReplayResult) -> None:
    """What the replay decided, as a log of its own. Raises OSError."""
    metadata = dict(session.metadata) | {"role": "replay", "config": json.dumps(msgspec.to_builtins(config))}
    offset_ns = session.wall_minus_mono_ns
    with whole_file(path) as file:
        writer = LogWriter(file, metadata)
        for one in result.decided:
            write_decided(writer, one, offset_ns)
        writer.finish()


def write_decided(writer: LogWriter, one: Decided, wall_minus_mono_ns: int) -> None:
    """One message as the recorder would have written it."""
    times = (one.t_ns + wall_minus_mono_ns, one.own_t_ns + wall_minus_mono_ns)
    writer.copy(
        one.stream.topic,
        one.stream.encoding,
        schema_of(one.source),
        times,
        sequence=one.event & 0xFFFFFFFF,
        data=one.data,
    )
