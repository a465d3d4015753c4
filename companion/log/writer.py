"""Messages into one MCAP file, each stream on a channel of its own with its schema."""

from __future__ import annotations

import json
import sys
import zlib
from collections.abc import Mapping
from typing import Any, BinaryIO, Final, Literal

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import CompressionType

from companion.core.messages import Pose
from companion.core.streams import Stream
from companion.log.encoding import encoded, schema_of, views
from companion.log.mcap_writer import WholeChunkWriter

Compression = Literal["zstd", "lz4", "none"]
METADATA: Final = "companion"
"""Name of the metadata record with version, configuration and clock of a log."""
CHECKSUM: Final = "crc32"
"""Key of a metadata record's checksum over its other values."""
LIBRARY: Final = "wsr-companion"
_COMPRESSION: Final[Mapping[Compression, CompressionType]] = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}


def checksum_of(values: Mapping[str, str]) -> str:
    """Over keys and values, whatever their order."""
    text = json.dumps({key: value for key, value in values.items() if key != CHECKSUM}, sort_keys=True)
    return f"{zlib.crc32(text.encode()):08x}"


# Bytes of MCAP records less their variable parts (https://mcap.dev/spec): what a message adds to its chunk, what a
# chunk and each of its channels add to the index, and what stands in the index once.
_MESSAGE_HEAD: Final = 31
_CHUNK_INDEX: Final = 84
_PER_CHANNEL: Final = 10
_INDEX_ONCE: Final = 512
_METADATA_INDEX: Final = 32
_CHUNKS_BETWEEN: Final = 16
"""Copies of the metadata: a megabyte of messages, or eleven seconds of a flight."""


def _bytes_of(name: str, values: Mapping[str, str]) -> int:
    """Of a metadata record and its line in the index."""
    pairs = sum(8 + len(key.encode()) + len(value.encode()) for key, value in values.items())
    return 9 + 8 + len(name.encode()) + pairs + _METADATA_INDEX + len(name.encode())


class LogWriter:
    """Writes to a binary `file`, which stays the caller's. The same messages give the same bytes.

    A chunk ends when it holds `chunk_bytes` before compression, or when the caller ends it. What a chunk tells of its
    channels for the first time is told once more behind the chunk after it, so that a log that has lost its index and
    this chunk can still be read. All metadata stand at the start, again behind the first chunk and every
    `_CHUNKS_BETWEEN` after it, and at the end, each with a checksum: nothing can be made of a log without them.
    """

    def __init__(
        self,
        file: BinaryIO,
        metadata: Mapping[str, str],
        compression: Compression = "zstd",
        chunk_bytes: int = 64 << 10,
    ) -> None:
        self._file = file
        self._chunk_bytes = chunk_bytes
        self._writer = WholeChunkWriter(file, chunk_size=sys.maxsize, compression=_COMPRESSION[compression])
        self._writer.start(profile="", library=LIBRARY)
        self._channels: dict[str, int] = {}
        self._copied: dict[tuple[str, str, tuple[str, str, bytes]], int] = {}
        self._pose: Pose | None = None
        self.chunks = 0
        """Ended so far."""
        self.open_bytes = 0
        """In the chunk that has not ended, before compression."""
        self._in_chunk: set[int] = set()
        self._told = RecordBuilder()  # schemas and channels of the open chunk
        self._told_before = b""  # and of the one before it
        self._index_bytes = _INDEX_ONCE
        self._metadata_bytes = 0
        self._metadata: dict[str, dict[str, str]] = {}
        self._repeated = 0
        """Chunks that had ended when the metadata were written last."""
        self.add_metadata(METADATA, metadata)

    @property
    def index_bytes(self) -> int:
        """What `finish` adds to the file behind the last chunk, at most."""
        return self._index_bytes + self._metadata_bytes

    def write(self, stream: Stream, log_time_ns: int, publish_time_ns: int, sequence: int, *, message: Any) -> None:
        """One message with the views drawn from it. Times are wall times; `sequence` is the number of its event."""
        data, source = encoded(stream, publish_time_ns, message)
        channel = self._channel(stream.topic, stream.encoding, source)
        self._add(channel, log_time_ns, data, publish_time_ns, sequence=sequence)
        if isinstance(message, Pose):
            self._pose = message
        for view, drawn in views(stream, publish_time_ns, message, self._pose):
            self.write(view, log_time_ns, publish_time_ns, sequence, message=drawn)

    def copy(
        self,
        topic: str,
        encoding: str,
        schema: tuple[str, str, bytes],
        times_ns: tuple[int, int],
        *,
        sequence: int,
        data: bytes,
    ) -> None:
        """A message that is encoded already, with its schema (name, encoding, data) and its (log, publish) times."""
        self._add(self._registered(topic, encoding, schema), times_ns[0], data, times_ns[1], sequence=sequence)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        self._metadata[name] = dict(values) | {CHECKSUM: checksum_of(values)}
        self._metadata_bytes = sum(_bytes_of(*record) for record in self._metadata.items())
        self._write_metadata(name)

    def end_chunk(self) -> None:
        """Ends the chunk, so that all messages so far are in the file."""
        if not self.open_bytes:
            return
        self._writer.flush()  # type: ignore[no-untyped-call]
        if self._told_before:
            self._file.write(self._told_before)
            self._file.flush()
        self._told_before = self._told.end()  # type: ignore[no-untyped-call]
        self._index_bytes += _CHUNK_INDEX + _PER_CHANNEL * len(self._in_chunk)
        self._in_chunk.clear()
        self.open_bytes = 0
        self.chunks += 1
        if self.chunks % _CHUNKS_BETWEEN == 1:
            self._repeat_metadata()

    def finish(self) -> None:
        """Writes the index. The file is whole after this."""
        self.end_chunk()
        if self.chunks != self._repeated:
            self._repeat_metadata()
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _repeat_metadata(self) -> None:
        for name in self._metadata:
            self._write_metadata(name)
        self._repeated = self.chunks

    def _write_metadata(self, name: str) -> None:
        self._writer.add_metadata(name, self._metadata[name])
        self._index_bytes += _METADATA_INDEX + len(name.encode())

    def _add(self, channel: int, log_time_ns: int, data: bytes, publish_time_ns: int, *, sequence: int) -> None:
        self._writer.add_message(channel, log_time_ns, data, publish_time_ns, sequence)
        self._in_chunk.add(channel)
        self.open_bytes += _MESSAGE_HEAD + len(data)
        if self.open_bytes >= self._chunk_bytes:
            self.end_chunk()

    def _channel(self, topic: str, encoding: str, source: Any) -> int:
        known = self._channels.get(topic)
        return self._registered(topic, encoding, schema_of(source)) if known is None else known

    def _registered(self, topic: str, encoding: str, schema: tuple[str, str, bytes]) -> int:
        """The channel of a topic; another encoding or schema on one topic gets another channel."""
        key = (topic, encoding, schema)
        if key not in self._copied:
            self._copied[key] = self._register(topic, encoding, schema)
            self._channels.setdefault(topic, self._copied[key])
        return self._copied[key]

    def _register(self, topic: str, encoding: str, schema: tuple[str, str, bytes]) -> int:
        name, kind, data = schema
        before = self._told.count
        schema_id = self._writer.register_schema(name, kind, data) if kind else 0
        if kind:
            Schema(id=schema_id, data=data, encoding=kind, name=name).write(self._told)
        channel = self._writer.register_channel(topic, encoding, schema_id)
        Channel(id=channel, topic=topic, message_encoding=encoding, schema_id=schema_id, metadata={}).write(self._told)
        told = self._told.count - before
        self.open_bytes += told
        self._index_bytes += told + _PER_CHANNEL
        return channel
