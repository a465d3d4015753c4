"""The golden logs: what they are cut from, how a replay of one is judged, how it is renewed.

A golden log holds the inputs of a few SAR iterations of a demo flight, and the decisions that this code makes of them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final

from companion.core.streams import ANSWER, BOOK, WISH, WORKER
from companion.log.reader import LoggedMessage, Session, metadata_of, open_session
from companion.log.repair import copy
from companion.log.writer import METADATA, LogWriter
from companion.replay.check import StreamCheck, check
from companion.replay.player import DECISION_TOPICS, INPUT_TOPICS, Decided, Player
from companion.replay.result import ReplayResult, replay_log, write_decided

FOLDER: Final = Path(__file__).parent
GOLDEN: Final = tuple(sorted(FOLDER.glob("*.mcap")))
_BEFORE_S: Final = 0.7
_ITERATIONS: Final = 12
"""Of which each shares most of its path with the one before."""
_AFTER_S: Final = 0.3


def replayed(session: Session) -> ReplayResult:
    with Player(session, session.config(), exact=True) as player:
        return replay_log(player, session, None)


def replayed_as(kind: type[Session], path: Path) -> ReplayResult:
    """Of a log whose messages or configuration this kind of session changes."""
    session = open_session(path)
    return replayed(kind(**{one.name: getattr(session, one.name) for one in fields(session)}))


def moved(session: Session, result: ReplayResult) -> list[StreamCheck]:
    """The streams in which the replay differs from the golden decisions."""
    checks = check(result.recorded, result.decided, result.start_ns + session.wall_minus_mono_ns)
    return [one for one in checks if one.difference is not None]


def renew(path: Path) -> list[StreamCheck]:
    """Puts what the code decides now in the place of the golden decisions; what moved."""
    session = open_session(path)
    result = replayed(session)
    found = moved(session, result)
    _write(path, session, list(session.messages(INPUT_TOPICS)), result)
    return found


def cut(flight: Path, path: Path) -> None:
    """A golden log from a flight's: from shortly before it was engaged until some iterations later."""
    session = open_session(flight)
    messages = list(session.messages(INPUT_TOPICS))
    engaged_ns = next(m.log_time_ns for m in messages if m.topic == WISH.topic)
    answers = [m.log_time_ns for m in messages if m.topic == ANSWER.topic]
    end_ns = answers[_ITERATIONS - 1] + round(_AFTER_S * 1e9)
    start_ns = engaged_ns - round(_BEFORE_S * 1e9)
    early = {WORKER.topic, BOOK.topic}
    ready = [replace(m, log_time_ns=max(m.log_time_ns, start_ns)) for m in messages if m.topic in early]
    kept = [m for m in messages if start_ns <= m.log_time_ns <= end_ns and m.topic not in early]
    kept = [m for m in ready if m.log_time_ns <= engaged_ns] + kept
    _write(path, session, kept, None)
    session = open_session(path)
    _write(path, session, kept, replayed(session))


def _write(path: Path, session: Session, inputs: list[LoggedMessage], result: ReplayResult | None) -> None:
    metadata = dict(metadata_of(session.paths[0])[METADATA])
    metadata["config"] = json.dumps(_placeless(json.loads(metadata["config"])))
    fresh = path.with_suffix(".new")
    with fresh.open("wb") as file:
        writer = LogWriter(file, metadata, chunk_bytes=256 << 10)
        decided: Iterator[Decided] = iter(()) if result is None else _by_event(result)
        waiting = next(decided, None)
        for message in inputs:
            while waiting is not None and waiting.event < message.sequence:
                write_decided(writer, waiting, session.wall_minus_mono_ns)
                waiting = next(decided, None)
            copy(writer, message)
        while waiting is not None:
            write_decided(writer, waiting, session.wall_minus_mono_ns)
            waiting = next(decided, None)
        writer.finish()
    fresh.replace(path)


def _placeless(config: dict[str, Any]) -> dict[str, Any]:
    """Where the flight's files were is nobody's business."""
    return config | {"runtime_dir": "/run/companion", "recorder": config["recorder"] | {"path": "log.mcap"}}


def _by_event(result: ReplayResult) -> Iterator[Decided]:
    return (one for one in result.decided if one.stream.topic in DECISION_TOPICS)
