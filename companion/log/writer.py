"""Messages into one MCAP file, each stream on a channel of its own with its schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, BinaryIO, Final, Literal

from mcap.writer import CompressionType, Writer

from companion.log.encoding import encoded, schema_of, views
from companion.messages import Pose
from companion.streams import Stream

Compression = Literal["zstd", "lz4", "none"]
METADATA: Final = "companion"
"""Name of the metadata record with version, configuration and clock of a log."""
LIBRARY: Final = "wsr-companion"
_COMPRESSION: Final[Mapping[Compression, CompressionType]] = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}


class LogWriter:
    """Writes to a binary `file`, which stays the caller's. The same messages give the same bytes."""

    def __init__(
        self,
        file: BinaryIO,
        metadata: Mapping[str, str],
        compression: Compression = "zstd",
        chunk_bytes: int = 128 << 10,
    ) -> None:
        self._writer = Writer(file, chunk_size=chunk_bytes, compression=_COMPRESSION[compression])
        self._writer.start(profile="", library=LIBRARY)
        self._writer.add_metadata(METADATA, dict(metadata))
        self._channels: dict[tuple[str, str], int] = {}
        self._pose: Pose | None = None

    def write(self, stream: Stream, log_time_ns: int, publish_time_ns: int, sequence: int, message: Any) -> None:
        """One message with the views drawn from it. Times are wall times; `sequence` is the number of its event."""
        data, source = encoded(stream, publish_time_ns, message)
        channel = self._channel(stream.topic, stream.encoding, source)
        self._writer.add_message(channel, log_time_ns, data, publish_time_ns, sequence)
        if isinstance(message, Pose):
            self._pose = message
        for view, drawn in views(stream, publish_time_ns, message, self._pose):
            self.write(view, log_time_ns, publish_time_ns, sequence, drawn)

    def copy(
        self,
        topic: str,
        encoding: str,
        schema: tuple[str, str, bytes],
        times_ns: tuple[int, int],
        sequence: int,
        data: bytes,
    ) -> None:
        """A message that is encoded already, with its schema (name, encoding, data) and its (log, publish) times."""
        self._writer.add_message(self._registered(topic, encoding, schema), times_ns[0], data, times_ns[1], sequence)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        self._writer.add_metadata(name, dict(values))

    def flush(self) -> None:
        """Ends the chunk, so that all messages so far are in the file."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Writes the index. The file is whole after this."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, encoding: str, source: Any) -> int:
        known = self._channels.get((topic, ""))
        return self._registered(topic, encoding, schema_of(source)) if known is None else known

    def _registered(self, topic: str, encoding: str, schema: tuple[str, str, bytes]) -> int:
        """The channel of a topic; a second schema on one topic gets a second channel."""
        key = (topic, schema[0])
        if key not in self._channels:
            name, kind, data = schema
            schema_id = self._writer.register_schema(name, kind, data) if kind else 0
            self._channels[key] = self._writer.register_channel(topic, encoding, schema_id)
            self._channels.setdefault((topic, ""), self._channels[key])
        return self._channels[key]
