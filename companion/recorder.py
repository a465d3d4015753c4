"""Every stream into one MCAP file, written by a thread of its own: a slow disk never holds up the vehicle."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import json
import logging
import os
import queue
import threading
import time
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from mcap.writer import CompressionType, Writer

from companion.errors import CompanionError
from companion.streams import Stream

_log = logging.getLogger(__name__)
_SYNC_S = 1.0
_CHUNK_BYTES = 128 << 10


class Recorder:
    """A bounded queue in front of a writer thread. When the queue is full the newest message is dropped and counted:
    the start of what went wrong is worth more than its end.

    A file that is there is never touched: the next free name is taken (log.mcap, log.1.mcap, ...), so that a restart
    keeps the log of what it restarted from. Raises CompanionError when no file can be created.
    """

    def __init__(self, path: Path, config: Any, version: str, queue_messages: int) -> None:
        self._file = _create(path)
        self._queue: queue.Queue[tuple[Stream, int, bytes] | None] = queue.Queue(queue_messages)
        # Log time is wall time at the start plus monotonic time since: it never steps.
        self._wall_minus_mono_ns = time.time_ns() - time.monotonic_ns()
        self._metadata = {"version": version, "config": json.dumps(msgspec.to_builtins(config))}
        self._schemas: dict[str, bytes] = {}
        self.dropped = 0
        self.written = 0
        self.failed = False
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)
        self._thread.start()

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """Queues one message: bytes as they are, a dataclass as JSON. Never blocks and never raises for a full disk."""
        data = message if isinstance(message, bytes) else msgspec.json.encode(message)
        if stream.topic not in self._schemas:
            self._schemas[stream.topic] = _schema(message)
        try:
            self._queue.put_nowait((stream, t_mono_ns, data))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Writes out what is queued and finishes the file."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()

    def _write_all(self) -> None:
        try:
            self._write_messages()
            self._file.close()
        except OSError as error:  # a full or failing disk must not disturb the flight; it is counted and shown
            self.failed = True
            _log.error("recording stopped: %s", error)
            with contextlib.suppress(OSError):  # the same error again, from what was still buffered
                self._file.close()
            while self._queue.get() is not None:
                self.dropped += 1

    def _write_messages(self) -> None:
        writer = Writer(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="", library="wsr-companion")
        writer.add_metadata("companion", self._metadata)
        channels: dict[str, int] = {}
        sequence: dict[str, int] = {}
        next_sync = time.monotonic() + _SYNC_S
        while (item := self._queue.get()) is not None:
            stream, t_mono_ns, data = item
            topic = stream.topic
            if topic not in channels:
                channels[topic] = self._register(writer, stream)
            sequence[topic] = sequence.get(topic, 0) + 1
            log_time_ns = t_mono_ns + self._wall_minus_mono_ns
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns, sequence[topic])
            self.written += 1
            if time.monotonic() >= next_sync:
                self._file.flush()
                os.fsync(self._file.fileno())
                next_sync = time.monotonic() + _SYNC_S
        writer.finish()  # type: ignore[no-untyped-call]

    def _register(self, writer: Writer, stream: Stream) -> int:
        schema = self._schemas[stream.topic]
        kind = "jsonschema" if stream.encoding == "json" else ""
        schema_id = writer.register_schema(stream.topic.strip("/"), kind, schema) if schema else 0
        return writer.register_channel(stream.topic, stream.encoding, schema_id)


def _create(path: Path) -> BinaryIO:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for number in itertools.count():
            name = path if number == 0 else path.with_suffix(f".{number}{path.suffix}")
            with contextlib.suppress(FileExistsError):
                return name.open("wb" if name.is_char_device() else "xb")
    except OSError as error:
        raise CompanionError(f"{path}: cannot write the log: {error.strerror}") from None
    raise AssertionError("unreachable")


def _schema(message: Any) -> bytes:
    """JSON schema of a dataclass with its definitions inlined where the top level stands; none for raw bytes."""
    if not dataclasses.is_dataclass(message):
        return b""
    (schema,), components = msgspec.json.schema_components([type(message)], ref_template="#/$defs/{name}")
    top = components.pop(type(message).__name__, schema)
    return json.dumps({**top, "$defs": components} if components else top).encode()
