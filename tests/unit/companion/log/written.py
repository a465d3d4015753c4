"""Logs of this program and of another one, byte by byte known."""

from __future__ import annotations

import io
import random
import struct
from typing import Any

from mcap.writer import CompressionType, Writer

from companion.core.streams import CSI
from companion.log.writer import LogWriter

METADATA_VALUES = {"role": "uav", "name": "uav", "config": '{"a": 1}' * 300, "session": "s", "wall_minus_mono_ns": "5"}
HEAD = struct.Struct("<BQ")


def log_of(messages: int = 4000, compression: Any = "zstd", chunk_bytes: int = 16 << 10) -> bytes:
    """A log of this program of some twenty chunks."""
    file = io.BytesIO()
    writer = LogWriter(file, METADATA_VALUES, compression, chunk_bytes=chunk_bytes)
    chance = random.Random(0)
    for number in range(messages):
        writer.write(CSI, number, number, number, message=chance.randbytes(60) + number.to_bytes(4, "little"))
    writer.finish()
    return file.getvalue()


def frames(content: bytes | bytearray) -> list[tuple[int, int, int]]:
    """(code, begin, end) of each record."""
    found, at = [], 8
    while at < len(content) - 8:
        code, length = HEAD.unpack_from(content, at)
        found.append((code, at, at + 9 + length))
        at += 9 + length
    return found


def foreign(crc: bool, topic: str = "/a", encoding: str = "json", data: bytes = b"{}") -> bytes:
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD, enable_crcs=crc)
    writer.start(profile="ros2", library="other")
    schema = writer.register_schema("H", "jsonschema", b"{}")
    channel = writer.register_channel(topic, encoding, schema, {"qos": "x"})
    writer.add_message(channel, 1, data, 1)
    writer.add_attachment(0, 0, "a.txt", "text/plain", b"abc")
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()
