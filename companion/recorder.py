"""Every stream into MCAP files, written by a thread of its own: a slow disk never holds up the vehicle."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import logging
import queue
import struct
import threading
import time
import uuid
from pathlib import Path
from typing import Any, Final, Protocol

import msgspec

from companion.config import Config
from companion.errors import CompanionError
from companion.event_clock import EventClock
from companion.log.parts import LogPart, open_part
from companion.streams import Stream

_log = logging.getLogger(__name__)
_FLUSH_S: Final = 0.5  # what a kill may cost at most
_SYNC_S: Final = 1.0  # what a power cut may cost at most, and the time the disk takes
_RETRY_S: Final = 5.0
_CLOSE_S: Final = 10.0

# A message that is not what its stream holds; OSError is the disk's.
_NOT_ENCODED: Final = (
    ValueError, TypeError, ArithmeticError, LookupError, AttributeError, struct.error, msgspec.MsgspecError, Warning
)  # fmt: skip

_Item = tuple[Stream, int, int, int, Any]


class Recorder(Protocol):
    """Where the service puts its messages."""

    @property
    def failed(self) -> bool:
        """Whether messages are lost now."""

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """Takes one message of `stream`, whose own time is `t_mono_ns`. Neither blocks nor raises."""

    def counters(self) -> dict[str, int]:
        """For health."""


class McapRecorder:
    """A bounded queue in front of a writer thread. When the queue is full the newest message is dropped and counted:
    the start of what went wrong is worth more than its end.

    A file that is there is never touched: the next free number is taken (log.mcap, log.1.mcap, ...), so that a restart
    keeps the log of what it restarted from. A file that has grown too large or too old is finished and the next part
    begun; the oldest finished files go when all together exceed the budget. A disk that fails or is full costs the
    messages of that time, which are counted; every few seconds a new part is tried. Raises CompanionError when the
    first file cannot be created.
    """

    def __init__(self, path: Path, config: Config, clock: EventClock) -> None:
        self._settings = config.recorder
        self._path = path
        self._clock = clock
        self._queue: queue.Queue[_Item | None] = queue.Queue(self._settings.queue_messages)
        # Log time is wall time at the start plus monotonic time since: it never steps.
        self._wall_minus_mono_ns = time.time_ns() - time.monotonic_ns()
        self._metadata = {
            "version": importlib.metadata.version("wsr-companion"),
            "role": config.role,
            "name": config.name,
            "config": json.dumps(msgspec.to_builtins(config)),
            "session": uuid.uuid4().hex,
            "wall_minus_mono_ns": str(self._wall_minus_mono_ns),
        }
        self._part_number = 0
        self.dropped = 0
        self.written = 0
        self.malformed = 0
        """Messages that could not be encoded; they count as dropped too."""
        self.failures = 0
        """Times the disk failed us."""
        self.removed_files = 0
        """Old files that the budget did not allow any more."""
        self._part: LogPart | None = self._next_part()
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """Queues bytes as they are, or a frozen message to be encoded by the writer."""
        item = (stream, self._clock.now_ns(), t_mono_ns, self._clock.number & 0xFFFFFFFF, message)
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self.dropped += 1

    @property
    def failed(self) -> bool:
        return self._part is None

    def counters(self) -> dict[str, int]:
        return {
            "written": self.written,
            "dropped": self.dropped,
            "malformed": self.malformed,
            "failures": self.failures,
            "queued": self._queue.qsize(),
            "removed_files": self.removed_files,
        }

    def close(self) -> None:
        """Writes out what is queued and finishes the file; gives up on a disk that hangs."""
        if self._thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put(None, timeout=_CLOSE_S)
            self._thread.join(_CLOSE_S)

    def _write_all(self) -> None:
        next_flush = next_sync = time.monotonic()
        retry = 0.0
        running = True
        while running:
            now = time.monotonic()
            try:
                if self._part is None and now >= retry:
                    self._part = self._next_part()
                if self._part is not None and now >= next_flush:
                    next_flush = now + _FLUSH_S
                    self._part.flush(sync=now >= next_sync)
                    next_sync = now + _SYNC_S if now >= next_sync else next_sync
                    self._turn_over()
                running = self._write_some(max(0.01, next_flush - time.monotonic()))
            except (OSError, CompanionError) as error:
                self._lose_part(error)
                retry = time.monotonic() + _RETRY_S
        with contextlib.suppress(OSError):
            if self._part is not None:
                self._part.finish()

    def _write_some(self, wait_s: float) -> bool:
        """Writes what is queued, for `wait_s` at most; False at the end."""
        until = time.monotonic() + wait_s
        while (left_s := until - time.monotonic()) > 0:
            try:
                item = self._queue.get(timeout=left_s)
            except queue.Empty:
                return True
            if item is None:
                return False
            if self._part is None:
                self.dropped += 1
                continue
            self._write(self._part, item)
        return True

    def _write(self, part: LogPart, item: _Item) -> None:
        """One message. One that cannot be encoded costs itself and nothing else."""
        stream, log_ns, own_ns, event, message = item
        offset_ns = self._wall_minus_mono_ns
        try:
            part.write(stream, log_ns + offset_ns, own_ns + offset_ns, event, message)
        except _NOT_ENCODED as error:
            if not self.malformed:
                _log.error("%s: a message cannot be recorded: %s", stream.topic, error)
            self.malformed += 1
            self.dropped += 1
            return
        self.written += 1

    def _turn_over(self) -> None:
        assert self._part is not None
        limit_s, limit_bytes = self._settings.rotate_s, self._settings.rotate_mb * 1e6
        if self._part.size_bytes < limit_bytes and self._part.age_s < limit_s:
            return
        finished, self._part = self._part, None
        finished.finish()
        self._part = self._next_part()

    def _next_part(self) -> LogPart:
        settings = self._settings
        metadata = self._metadata | {"part": str(self._part_number)}
        part = open_part(self._path, metadata, settings.compression, settings.chunk_kb << 10)
        self._part_number += 1
        budget_bytes = round((settings.budget_mb - settings.rotate_mb) * 1e6)
        self.removed_files += part.remove_oldest(max(0, budget_bytes))
        return part

    def _lose_part(self, error: Exception) -> None:
        """The disk must not disturb the flight: what is lost is counted and shown."""
        if self._part is not None:
            lost = self._part.abandon()
            self.written -= lost
            self.dropped += lost
        if self.failures == 0:
            _log.error("recording interrupted: %s; trying again every %g s", error, _RETRY_S)
        self._part = None
        self.failures += 1
