"""Byte for byte what the library itself writes."""

from __future__ import annotations

import io
import random
import sys

import pytest
from mcap.writer import CompressionType, Writer

from companion.log import mcap_writer
from companion.log.mcap_writer import WholeChunkWriter


def _written(make: type[Writer]) -> bytes:
    file, draw = io.BytesIO(), random.Random(4)
    writer = make(file, chunk_size=sys.maxsize, compression=CompressionType.ZSTD)
    writer.start(profile="", library="test")
    schema = writer.register_schema("S", "jsonschema", b"{}")
    channels = [writer.register_channel(f"/{number}", "json", schema) for number in range(3)]
    for number in range(500):
        log_ns = 10**18 + draw.randrange(10**6)
        writer.add_message(draw.choice(channels), log_ns, draw.randbytes(draw.randrange(300)), log_ns - 5, number)
        if number % 90 == 7:
            writer.flush()  # type: ignore[no-untyped-call]
    writer.add_metadata("m", {"a": "b"})
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def test_the_bytes_are_those_of_the_library() -> None:
    assert _written(WholeChunkWriter) == _written(Writer)


def test_a_library_that_is_made_otherwise_writes_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_writer, "_CHUNK", "_Writer__elsewhere")
    assert _written(WholeChunkWriter) == _written(Writer)
