"""The records of an MCAP file in their order, chunks opened; what is damaged is passed over and counted.

Each record is read within the length that stands before it, and what it holds within the record: a damaged length costs
its own record. A file that ends in mid record gives what stands before. Where the framing itself is damaged, reading
goes on at the next chunk that can be recognised.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from typing import BinaryIO, Final

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

UNREADABLE: Final = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    RuntimeError,
    UnicodeDecodeError,
    EOFError,
    ValueError,
    MemoryError,
)
"""What reading raises where a file ends in mid record, in mid chunk or in mid number, or where these are damaged."""

COMPRESSIONS: Final = ("zstd", "lz4", "")
MAGIC_BYTES: Final = len(MCAP0_MAGIC)
_BEGINNING: Final = MCAP0_MAGIC + bytes([Opcode.HEADER])
_MARKS: Final = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MARK_AT: Final = 37
"""Of the name of its compression in a chunk: code, length, two times, size and checksum stand before it."""
_HEAD: Final = struct.Struct("<BQ")
_CHUNK_HEAD: Final = struct.Struct("<QQQII")
_LARGEST: Final = 1 << 28
"""Of a record that is read, and of what a chunk unpacks to: a damaged length takes no more memory."""
_PIECE: Final = 1 << 20
_KNOWN: Final = frozenset(int(code) for code in Opcode)
_FOOTER_BYTES: Final = 20
_FOOTER_CRC_BYTES: Final = 4


@dataclass(frozen=True, slots=True)
class _Frame:
    """Where a record is."""

    code: int
    at: int
    end: int


class RecordScan:
    """One pass over `file`, which stays the caller's.

    With `past_damage` reading goes on after what is damaged, else it ends there as at a cut. Records of `passed_over`
    are not read, only skipped: `(Opcode.CHUNK,)` gives what stands outside of the chunks, quickly; checksums over more
    than one chunk are then not looked at.
    """

    def __init__(self, file: BinaryIO, past_damage: bool = True, passed_over: tuple[int, ...] = ()) -> None:
        self._file = file
        self._past_damage = past_damage
        self._passed_over = passed_over
        self._size = os.fstat(file.fileno()).st_size
        self._crc = zlib.crc32(MCAP0_MAGIC)
        self._is_continuous = not passed_over
        """Whether all bytes since the checksum began have been in it."""
        self._read_to = MAGIC_BYTES
        """The end of the last record that was more than skipped: a cut one may reach into what stands behind it."""
        self.is_whole = False
        """Whether the file ended as it should and all of it could be read; known afterwards."""
        self.damaged = 0
        """Places that were passed over, or at which reading ended though more chunks follow."""
        self.lost_bytes = 0
        """In these places."""
        self.another_at: int | None = None
        """Where another log begins behind this one, as when two files were joined; reading ends before it."""
        self.chunks = 0
        """That could be opened."""
        self.unknown: set[str] = set()
        """Compressions that nobody here knows."""

    def __iter__(self) -> Iterator[McapRecord]:
        at = MAGIC_BYTES
        self._file.seek(0)
        if self._file.read(MAGIC_BYTES) != MCAP0_MAGIC:
            at = self._passed(0)
        while 0 <= at < self._size:
            frame = self._frame(at)
            if frame is None:
                at = self._passed(at)
                continue
            self._file.seek(at)
            try:
                records = [] if frame.code in self._passed_over else self._opened(frame)
            except UNREADABLE:
                at = self._passed(at, frame.end)
                continue
            at = frame.end
            if frame.code in _READ or frame.code == Opcode.ATTACHMENT:
                self._read_to = at
            yield from records
            if frame.code == Opcode.FOOTER:
                self._file.seek(at)
                is_end = self._file.read(MAGIC_BYTES) == MCAP0_MAGIC and at + MAGIC_BYTES == self._size
                self.is_whole = is_end and self.damaged == 0
                self.another_at = None if is_end else self._find(_beginning, at)
                return

    def _frame(self, at: int) -> _Frame | None:
        """The record at a place; None where there can be none."""
        self._file.seek(at)
        head = self._file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        code, length = _HEAD.unpack(head)
        end = at + _HEAD.size + length
        return _Frame(code, at, end) if code != 0 and end <= self._size else None

    def _opened(self, frame: _Frame) -> list[McapRecord]:
        """The record of a frame, of a chunk those in it. Raises one of UNREADABLE."""
        if frame.code != Opcode.CHUNK and self._looks_like_a_chunk(frame):
            raise ValueError("the code of a chunk was damaged")
        if frame.code not in _READ:
            self._skip(frame)
            return []
        if frame.end - frame.at > _LARGEST:
            raise ValueError("larger than any record that is read")
        data = self._file.read(frame.end - frame.at)
        if len(data) != frame.end - frame.at:
            raise EOFError
        content = data[_HEAD.size :]
        if frame.code == Opcode.DATA_END:
            self._check(_u32(content))
            self._crc, self._is_continuous = 0, not self._passed_over
        elif frame.code == Opcode.FOOTER:
            if len(content) != _FOOTER_BYTES:
                raise ValueError("not the size of a footer")
            self._crc = zlib.crc32(data[:-_FOOTER_CRC_BYTES], self._crc)
            self._check(_u32(content[-_FOOTER_CRC_BYTES:]))
        else:
            self._crc = zlib.crc32(data, self._crc)
        if frame.code == Opcode.CHUNK:
            opened = list(_records_in(self._unpacked(content)))
            self.chunks += 1
            return opened
        return [_READ[frame.code](content)]

    def _looks_like_a_chunk(self, frame: _Frame) -> bool:
        """Whether the name of a compression stands where a chunk has it."""
        self._file.seek(frame.at + _MARK_AT)
        found = self._file.read(max(map(len, _MARKS))).startswith(_MARKS)
        self._file.seek(frame.at)
        return found

    def _skip(self, frame: _Frame) -> None:
        left = frame.end - frame.at
        while left and self._is_continuous:
            piece = self._file.read(min(left, _PIECE))
            if not piece:
                raise EOFError
            self._crc = zlib.crc32(piece, self._crc)
            left -= len(piece)

    def _check(self, crc: int) -> None:
        """All records are there, but not as they were written."""
        if crc and self._is_continuous and crc != self._crc:
            self.damaged += 1

    def _unpacked(self, content: bytes) -> bytes:
        *_, size, crc, named = _CHUNK_HEAD.unpack_from(content)
        at = _CHUNK_HEAD.size + named
        name = content[_CHUNK_HEAD.size : at].decode()
        (length,) = struct.unpack_from("<Q", content, at)
        packed = content[at + 8 :]
        if length != len(packed) or size > _LARGEST:
            raise ValueError("the chunk says otherwise of its size than its record")
        if name not in COMPRESSIONS:
            self.unknown.add(name)
            raise ValueError(f"compression {name}")
        data = _decompressed(name, packed, size)
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise ValueError("the chunk is not as it was written")
        return data

    def _passed(self, at: int, following: int | None = None) -> int:
        """Where reading goes on after damage at `at`; -1 where it ends. `following` is where the next record would be
        if only this one is damaged."""
        self._is_continuous = False
        is_sound = following is not None and self._is_sound(following)
        next_at = following if is_sound else self._find(_chunk, at)
        another = None if is_sound or at == 0 else self._find(partial(_beginning, before=next_at), self._read_to)
        if another is not None:
            self.another_at, next_at = another, None
        if next_at is None:  # nothing more: the file was cut off here
            return -1
        self.damaged += 1
        self.lost_bytes += next_at - at
        self._read_to = next_at
        return next_at if self._past_damage else -1

    def _is_sound(self, at: int) -> bool:
        """Whether a record of a known kind stands there, and another behind it, or the end."""
        for _ in range(2):
            frame = self._frame(at)
            if frame is None or frame.code not in _KNOWN:
                return False
            at = frame.end
            if frame.code == Opcode.FOOTER or at == self._size:
                return True
        return True

    def _find(self, what: Callable[[mmap.mmap, int], int | None], good: int) -> int | None:
        if not self._size:
            return None
        with mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            return what(content, good)


def _beginning(content: mmap.mmap, good: int, before: int | None = None) -> int | None:
    """Where the first log behind `good` begins."""
    at = content.find(_BEGINNING, good, len(content) if before is None else before)
    return None if at < 0 else at


def _chunk(content: mmap.mmap, good: int) -> int | None:
    """Where the first whole chunk behind `good` begins."""
    return min((place for mark in _MARKS if (place := _marked(content, mark, good)) is not None), default=None)


def _marked(content: mmap.mmap, mark: bytes, good: int) -> int | None:
    at = content.find(mark, good + _MARK_AT + 1)
    while at >= 0:
        code, length = _HEAD.unpack_from(content, at - _MARK_AT)
        if code == Opcode.CHUNK and at - _MARK_AT + _HEAD.size + length <= len(content):
            return at - _MARK_AT
        at = content.find(mark, at + 1)
    return None


def _decompressed(name: str, packed: bytes, size: int) -> bytes:
    """Of no more than `size` bytes. Raises one of UNREADABLE."""
    if name == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
            return bytes(stream.read(size + 1))
    if name == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    return packed


def _records_in(data: bytes) -> Iterator[McapRecord]:
    """Schemas, channels and messages of a chunk. Raises one of UNREADABLE."""
    at = 0
    while at < len(data):
        code, length = _HEAD.unpack_from(data, at)
        start, at = at + _HEAD.size, at + _HEAD.size + length
        if at > len(data):
            raise EOFError("a record ends outside of its chunk")
        if code == 0:  # which no record has; of a chunk of zeros each nine bytes would be one
            raise ValueError("zeros where a record begins")
        if code in _IN_CHUNK:
            yield _READ[code](data[start:at])


def _u32(content: bytes) -> int:
    (value,) = struct.unpack("<I", content)
    return int(value)


class _Within(ReadDataStream):
    """The content of a record, which no length in it leaves."""

    def read(self, length: int) -> bytes:
        data: bytes = super().read(length)
        if len(data) != length:
            raise EOFError("a length leaves its record")
        return data


def _stream(content: bytes) -> ReadDataStream:
    return _Within(BytesIO(content))


def _message(content: bytes) -> Message:
    channel, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(content)
    return Message(
        channel_id=channel,
        log_time=log_ns,
        data=content[_MESSAGE_HEAD.size :],
        publish_time=publish_ns,
        sequence=sequence,
    )


_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_READ: Final[Mapping[int, Callable[[bytes], McapRecord]]] = {
    Opcode.HEADER: lambda content: Header.read(_stream(content)),
    Opcode.SCHEMA: lambda content: Schema.read(_stream(content)),
    Opcode.CHANNEL: lambda content: Channel.read(_stream(content)),
    Opcode.MESSAGE: _message,
    Opcode.CHUNK: lambda content: Chunk.read(_stream(content)),
    Opcode.METADATA: lambda content: Metadata.read(_stream(content)),
    Opcode.DATA_END: lambda content: DataEnd.read(_stream(content)),
    Opcode.FOOTER: lambda content: Footer.read(_stream(content)),
}
"""Kinds that are read; of the others nothing is needed."""
_IN_CHUNK: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
