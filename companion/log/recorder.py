"""Every stream into MCAP files, written by a thread of its own: a slow disk never holds up the vehicle."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import queue
import struct
import threading
import time
import uuid
from pathlib import Path
from typing import Any, Final

import msgspec

from companion import __version__
from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.streams import Stream
from companion.errors import CompanionError
from companion.log.parts import LogPart, open_part, remove_oldest

_log = logging.getLogger(__name__)
_CHUNK_S: Final = 0.85
"""The oldest message of a chunk waits no longer than this: what a kill may cost, less than a second by a margin for a
writer that is not scheduled at once."""
_SYNC_S: Final = 1.0
"""What a power cut may cost at most, and the time the disk takes."""
_IDLE_S: Final = 0.5
_GATHER_S: Final = 0.25
"""A writer that has nothing to do lets messages gather: woken by each of some 400 a second it took twice the
processor's time, and the control loop's to be woken. Never past the time that a chunk has to end."""
_AT_ONCE: Final = 256
"""Messages that are written before the writer looks up."""
_LARGEST_BYTES: Final = 512 << 10
"""No message is larger than this, by far: an aperture of 1000 packets measures 50 kB, a profile 65."""
_RETRY_S: Final = 5.0
_CLOSE_S: Final = 10.0

# A message that is not what its stream holds; OSError is the disk's.
_NOT_ENCODED: Final = (
    ValueError, TypeError, ArithmeticError, LookupError, AttributeError, struct.error, msgspec.MsgspecError, Warning
)  # fmt: skip

_Item = tuple[float, Stream, int, int, int, Any]


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
        # Whoever records pays for it 400 times a second: this queue takes no lock of Python's. Its length is looked at
        # before a message is put into it, so that threads that do at once may pass the limit by one each.
        self._queue: queue.SimpleQueue[_Item | None] = queue.SimpleQueue()
        # Log time is wall time at the start plus monotonic time since: it never steps.
        self._wall_minus_mono_ns = time.time_ns() - time.monotonic_ns()
        self._metadata = {
            "version": __version__,
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
        self._told = ""
        """Why it failed last: said once, however often it is tried again."""
        self.removed_files = 0
        """Old files that the budget did not allow any more."""
        _make_own_folder(path, config)
        self._part: LogPart | None = self._next_part()
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """Queues bytes as they are, or a frozen message to be encoded by the writer."""
        if self._queue.qsize() >= self._settings.queue_messages:
            self.dropped += 1
            return
        clock = self._clock
        self._queue.put((time.monotonic(), stream, clock.now_ns(), t_mono_ns, clock.number & 0xFFFFFFFF, message))

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
            self._queue.put(None)
            self._thread.join(_CLOSE_S)

    def _write_all(self) -> None:
        retry_s = 0.0
        running = True
        while running:
            try:
                if self._part is None and time.monotonic() >= retry_s:
                    self._part = self._next_part()
                running = self._write_next()
            except (OSError, CompanionError) as error:
                self._lose_part(error)
                retry_s = time.monotonic() + _RETRY_S
        with contextlib.suppress(OSError):
            if self._part is not None:
                self._part.finish()

    def _write_next(self) -> bool:
        """Writes what waits, ends a chunk that is old or syncs one that none followed; False at the end. An old
        chunk still takes what waits in the queue, so that a disk that was slow does not make many small ones."""
        part = self._part
        chunk_due_s = (math.inf if part is None else part.oldest_s) + _CHUNK_S
        sync_due_s = (math.inf if part is None else part.unsynced_since_s) + _SYNC_S
        if self._queue.empty():
            time.sleep(max(0.0, min(_GATHER_S, min(chunk_due_s, sync_due_s) - time.monotonic())))
        try:
            item = self._queue.get(timeout=max(0.0, min(_IDLE_S, min(chunk_due_s, sync_due_s) - time.monotonic())))
        except queue.Empty:
            now_s = time.monotonic()
            if part is not None and now_s >= chunk_due_s:
                part.end_chunk()
                self._chunk_ended(part)
            elif part is not None and now_s >= sync_due_s:
                part.sync(unless_within_s=0.0)
            return True
        for left in reversed(range(_AT_ONCE)):
            if item is None:
                return False
            if self._part is None:
                self.dropped += 1
            elif self._write(self._part, item):
                self._chunk_ended(self._part)
            if not left or self._queue.empty():
                break
            item = self._queue.get()  # nobody else takes from it
        return True

    def _write(self, part: LogPart, item: _Item) -> bool:
        """One message; whether a chunk ended with it. One that cannot be encoded costs itself and nothing else."""
        taken_s, stream, log_ns, own_ns, event, message = item
        offset_ns = self._wall_minus_mono_ns
        try:
            has_ended = part.write(
                stream, log_ns + offset_ns, own_ns + offset_ns, event, message=message, taken_s=taken_s
            )
        except _NOT_ENCODED as error:
            if not self.malformed:
                _log.error("%s: a message cannot be recorded: %s", stream.topic, error)
            self.malformed += 1
            self.dropped += 1
            return False
        except OSError:  # what was in its chunk before it is counted by whoever closes the file
            self.dropped += 1
            raise
        self.written += 1
        return has_ended

    def _chunk_ended(self, part: LogPart) -> None:
        """To the disk, unless the next chunk can still be within a second of the last sync; and on to the next file
        before this one could exceed its size."""
        part.sync(unless_within_s=_SYNC_S - _CHUNK_S)
        room_bytes = 2 * (self._settings.chunk_kb << 10) + _LARGEST_BYTES  # of the next chunk, its messages' index too
        is_full = part.finished_bytes + room_bytes > self._settings.rotate_mb * 1e6
        if is_full or part.age_s >= self._settings.rotate_s:
            part.finish()
            self._part = self._next_part()

    def _next_part(self) -> LogPart:
        """The others are made to fit first, with room for this one to grow."""
        settings = self._settings
        self.removed_files += remove_oldest(self._path, round((settings.budget_mb - settings.rotate_mb) * 1e6))
        metadata = self._metadata | {"part": str(self._part_number)}
        part = open_part(self._path, metadata, settings.compression, settings.chunk_kb << 10)
        self._part_number += 1
        return part

    def _lose_part(self, error: Exception) -> None:
        """The disk must not disturb the flight: what is lost is counted and shown."""
        if self._part is not None:
            lost = self._part.abandon()
            self.written -= lost
            self.dropped += lost
        if str(error) != self._told:
            self._told = str(error)
            _log.error("recording interrupted: %s; trying again every %g s", error, _RETRY_S)
        self._part = None
        self.failures += 1


def _make_own_folder(path: Path, config: Config) -> None:
    """The service's own runtime directory is made as for its sockets; any other folder has to be there."""
    if path.parent == config.path(""):
        with contextlib.suppress(OSError):  # whoever opens the file says what is wrong
            path.parent.mkdir(parents=True, exist_ok=True)
