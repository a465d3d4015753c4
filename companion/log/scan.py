"""The records of an MCAP file in their order, chunks opened; what is damaged is passed over and counted.

A file that ends in mid record gives what stands before. A chunk that fails its checksum costs itself. Where the
framing of the records itself is damaged, reading goes on at the next chunk that can be recognised.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from typing import BinaryIO, Final

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, DataEnd, McapRecord
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

UNREADABLE: Final = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    UnicodeDecodeError,
    EOFError,
    ValueError,
)
"""What the reader raises where a file ends in mid record, in mid chunk or in mid number."""

_MARKS: Final = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MARK_AT: Final = 37
"""Of the name of its compression in a chunk: code, length, two times, size and checksum stand before it."""
_HEAD: Final = struct.Struct("<BQ")


class RecordScan:
    """One pass over `file`, which stands at its beginning and stays the caller's.

    With `past_damage` reading goes on after what is damaged, else it ends there as at a cut.
    """

    def __init__(self, file: BinaryIO, past_damage: bool = True) -> None:
        self._file = file
        self._past_damage = past_damage
        self.is_whole = False
        """Whether the file ended as it should and all of it could be read; known afterwards."""
        self.damaged = 0
        """Places that were passed over, or at which reading ended though more chunks follow."""

    def __iter__(self) -> Iterator[McapRecord]:
        records = StreamReader(self._file, emit_chunks=True, validate_crcs=True).records
        good = 0
        while True:
            try:
                record = next(records)
                opened = breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]
            except StopIteration:
                self.is_whole = self.damaged == 0
                return
            except UNREADABLE as error:
                following = self._next_chunk(good)
                if following is None:
                    # All records are there, but not as they were written: an index is damaged.
                    self.damaged += isinstance(error, CRCValidationError) and isinstance(error.record, DataEnd)
                    return
                self.damaged += 1
                if not self._past_damage:
                    return
                self._file.seek(following)
                records = StreamReader(self._file, skip_magic=True, emit_chunks=True).records
                good = following
                continue
            good = self._file.tell()
            yield from opened

    def _next_chunk(self, good: int) -> int | None:
        """Where the first whole chunk behind the record at `good` begins."""
        with mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            places = [place for mark in _MARKS if (place := _find(content, mark, good)) is not None]
        return min(places, default=None)


def _find(content: mmap.mmap, mark: bytes, good: int) -> int | None:
    at = content.find(mark, good + _MARK_AT + 1)
    while at >= 0:
        code, length = _HEAD.unpack_from(content, at - _MARK_AT)
        if code == Opcode.CHUNK and at - _MARK_AT + _HEAD.size + length <= len(content):
            return at - _MARK_AT
        at = content.find(mark, at + 1)
    return None
