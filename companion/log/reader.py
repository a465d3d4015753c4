"""Messages of MCAP logs, in file order, from whole and from truncated files, and from all parts of a recording."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
from google.protobuf.message import DecodeError as ProtobufDecodeError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from companion import __version__
from companion.config.file import config_of
from companion.config.schema import Config
from companion.core.streams import CSI, NEIGHBOUR, POSE_IN
from companion.errors import CompanionError, ConfigError
from companion.log.parts import parts_beside
from companion.log.scan import MAGIC_BYTES, RecordScan
from companion.log.writer import CHECKSUM, LIBRARY, METADATA, checksum_of
from csi_bridge.foreign import TEXT, foreign_format
from csi_bridge.regular_file import open_regular

_FIRST_BYTES: Final = 4096
_LINE_ENDS_CHANGED: Final = (MCAP0_MAGIC[:-2] + b"\r\r", MCAP0_MAGIC[:-2] + b"\n")
"""Beginnings of a log in which each end of a line became \\r\\n or \\r, or each \\r\\n became \\n."""
EMPTY: Final = "empty; nothing was written to it"
"""What is wrong with a log of no bytes. It can be read, as the part that a recorder had just begun when it died."""
_NO_SCHEMA: Final = ("", "", b"")
Progress = Callable[[int, int], None]
"""Called with the bytes read and the bytes there are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedMessage:
    """One message as recorded; `data` is encoded as its stream says."""

    topic: str
    log_time_ns: int
    """When it was recorded, wall time."""
    data: bytes
    publish_time_ns: int = 0
    """What its own time stamp is, wall time."""
    sequence: int = 0
    """Number of the event in which it was recorded."""
    encoding: str = ""
    schema: tuple[str, str, bytes] = _NO_SCHEMA
    """Name, encoding and text."""


class LogScan:
    """One pass over one file. Iterating gives its messages; the rest is known afterwards.

    A file that ends in mid record gives what stands before, and what is damaged is passed over (`companion.log.scan`);
    without `past_damage` a damaged file ends where the damage begins. Raises CompanionError for what is no log.
    """

    def __init__(
        self,
        path: Path,
        topics: Container[str] | None = None,
        progress: Progress | None = None,
        past_damage: bool = True,
    ) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.is_whole = False
        self.damaged = 0
        """Places at which something could not be read, though the file goes on."""
        self.lost_bytes = 0
        """In these places."""
        self.another_at: int | None = None
        """As `companion.log.scan` says; what stands there is not read."""
        self.size_bytes = 0
        self.is_own = False
        """Whether its header or its metadata say that this program wrote it."""
        self.has_header = False
        self._topics = topics
        self._progress = progress
        self._past_damage = past_damage

    def __iter__(self) -> Iterator[LoggedMessage]:
        try:
            with open_regular(self.path) as file:
                self.size_bytes = self.path.stat().st_size
                magic = file.read(MAGIC_BYTES)
                _refuse_changed_ends(self.path, magic)
                records = RecordScan(file, self._past_damage)
                yield from self._messages(records, file)
                self.is_whole, self.damaged = records.is_whole, records.damaged
                self.lost_bytes, self.another_at = records.lost_bytes, records.another_at
        except OSError as error:
            raise CompanionError(f"{self.path}: cannot read the log: {error.strerror}") from None
        if records.unknown and not records.chunks:
            names = ", ".join(sorted(map(repr, records.unknown)))
            raise CompanionError(f"{self.path}: compression {names} is not known; expected zstd, lz4 or none")
        if magic != MCAP0_MAGIC[: len(magic)] and not records.chunks:
            if records.damaged:
                raise CompanionError(f"{self.path}: damaged at its beginning (companion log repair saves the rest)")
            raise CompanionError(f"{self.path}: {_no_mcap(self.path)}")

    def _messages(self, records: RecordScan, file: BinaryIO) -> Iterator[LoggedMessage]:
        channels: dict[int, Channel] = {}
        schemas: dict[int, tuple[str, str, bytes]] = {0: _NO_SCHEMA}
        has_learned = False
        for record in records:
            match record:
                case Message():  # first, since nearly all are
                    if record.channel_id not in channels and not has_learned:  # it was told in a chunk that is damaged
                        has_learned = True
                        self._learn_from_all(channels, schemas)
                    channel = channels.get(record.channel_id)
                    if channel is None or (self._topics is not None and channel.topic not in self._topics):
                        continue
                    if self._progress is not None:
                        self._progress(file.tell(), self.size_bytes)
                    yield LoggedMessage(
                        topic=channel.topic,
                        log_time_ns=record.log_time,
                        data=record.data,
                        publish_time_ns=record.publish_time,
                        sequence=record.sequence,
                        encoding=channel.message_encoding,
                        schema=schemas.get(channel.schema_id, _NO_SCHEMA),
                    )
                case Schema():
                    schemas[record.id] = (record.name, record.encoding, record.data)
                case Channel():
                    channels[record.id] = record
                case Header():
                    self.has_header = True
                    self.is_own = self.is_own or record.library == LIBRARY
                case Metadata():
                    self.is_own = self.is_own or record.name == METADATA
                    _take_metadata(record, self.metadata)

    def _learn_from_all(self, channels: dict[int, Channel], schemas: dict[int, tuple[str, str, bytes]]) -> None:
        """Channels and schemas from wherever they can be read: the end of a finished file tells all of them again."""
        with open_regular(self.path) as file:
            for record in RecordScan(file):
                match record:
                    case Schema():
                        schemas.setdefault(record.id, (record.name, record.encoding, record.data))
                    case Channel():
                        channels.setdefault(record.id, record)


def refuse_joined(scan: LogScan) -> None:
    """Raises CompanionError where another log follows the one that was read: all of it would be lost."""
    if scan.another_at is not None:
        raise CompanionError(f"{scan.path}: {joined_line(scan.another_at)}")


def joined_line(another_at: int) -> str:
    """What to do with two logs in one file."""
    return (
        f"another log begins at byte {another_at}; split the file there: `head -c {another_at}` gives the first, "
        f"`tail -c +{another_at + 1}` the rest (companion log merge joins logs)"
    )


def read_log(path: Path, topics: Container[str]) -> list[LoggedMessage]:
    """All messages of `topics` in one file. Raises CompanionError."""
    return list(LogScan(path, topics))


@dataclass(frozen=True, slots=True)
class Session:
    """All parts of one recording, from a start of the service to its end."""

    paths: tuple[Path, ...]
    metadata: Mapping[str, str]
    """Of the first part, as the recorder wrote it."""
    missing_parts: int
    """Parts before the first that is there."""

    @property
    def wall_minus_mono_ns(self) -> int:
        """Log time less the service's monotonic time. Raises CompanionError."""
        text = self.metadata.get("wall_minus_mono_ns", "")
        if not re.fullmatch(r"-?\d{1,19}", text):
            raise CompanionError(f"{self.paths[0]}: its clock cannot be read: wall_minus_mono_ns is {text[:40]!r}")
        return int(text)

    def config(self) -> Config:
        """The configuration the service ran with. Raises CompanionError when there is none, or this version cannot
        read it."""
        if "config" not in self.metadata:
            role = self.metadata.get("role", "unknown")
            raise CompanionError(
                f"{self.paths[0]}: a log of role {role} holds no configuration; expected a flight's log"
            )
        where = f"{self.paths[0]}: its configuration"
        try:
            document = msgspec.json.decode(self.metadata["config"])
        except (msgspec.DecodeError, RecursionError) as error:
            raise CompanionError(f"{where} is damaged: {error}") from None
        if not isinstance(document, dict):
            raise CompanionError(f"{where} is damaged: expected a mapping of keys")
        try:
            return config_of(document, where)
        except ConfigError as error:
            of = f"recorded by version {self.metadata.get('version', 'unknown')}, which reads it; this is {__version__}"
            raise CompanionError(f"{error}\n  {of}") from None

    def messages(
        self,
        topics: Container[str] | None = None,
        progress: Progress | None = None,
        on_cut: Callable[[Path], None] | None = None,
        past_damage: bool = True,
    ) -> Iterator[LoggedMessage]:
        """Of all parts in their order. `on_cut` is told of each file that is cut off or damaged. Without `past_damage`
        the first damage ends it. Raises CompanionError, behind the last message, where another log follows."""
        total = sum(path.stat().st_size for path in self.paths)
        done = 0
        for path in self.paths:
            before = done

            def read(at: int, _: int, before: int = before) -> None:
                if progress is not None:
                    progress(before + at, total)

            scan = LogScan(path, topics, read, past_damage)
            yield from scan
            refuse_joined(scan)
            done += path.stat().st_size
            if not scan.is_whole and on_cut is not None:
                on_cut(path)
            if scan.damaged and not past_damage:
                return


def open_session(path: Path) -> Session:
    """The recording that `path` is a part of. Raises CompanionError when it is no log of this program."""
    own = metadata_of(path)
    if METADATA not in own:
        raise CompanionError(f"{path}: {_why_no_log(path)}")
    metadata = own[METADATA]
    session = metadata.get("session")
    parts = {_part_number(path, metadata): (path, metadata)}
    for beside in _parts_beside(path):
        found = metadata_of(beside).get(METADATA, {})
        if session is not None and found.get("session") == session:
            parts.setdefault(_part_number(beside, found), (beside, found))
    numbers = sorted(parts)
    gap = next((number for number in range(numbers[0], numbers[-1]) if number not in parts), None)
    if gap is not None:
        raise CompanionError(f"{path}: part {gap} of its recording is missing beside it")
    return Session(tuple(parts[n][0] for n in numbers), parts[numbers[0]][1], numbers[0])


def _parts_beside(path: Path) -> list[Path]:
    try:
        return parts_beside(_first_of(path))
    except OSError as error:
        raise CompanionError(f"{path.parent}: cannot look for the log's other parts: {error.strerror}") from None


def _part_number(path: Path, metadata: Mapping[str, str]) -> int:
    text = metadata.get("part", "0")
    if not re.fullmatch(r"\d{1,9}", text):
        raise CompanionError(f"{path}: its metadata are damaged: part {text[:40]!r}; expected a number")
    return int(text)


def metadata_of(path: Path) -> dict[str, dict[str, str]]:
    """The metadata records of a file, each as it stands there first without damage; nothing else is read, and nothing
    behind the first that are whole. Empty for what is no log. Raises CompanionError for what cannot be read."""
    found: dict[str, dict[str, str]] = {}
    is_sound = True
    try:
        with open_regular(path) as file:
            scan = RecordScan(file, passed_over=(Opcode.CHUNK, Opcode.ATTACHMENT))
            for record in scan:
                if isinstance(record, Metadata):
                    if METADATA in found and record.name == METADATA and is_sound:
                        break  # the next copy of all of them
                    is_sound = _take_metadata(record, found) and is_sound
                elif METADATA in found and not isinstance(record, Header) and is_sound and not scan.damaged:
                    break
    except OSError as error:
        raise CompanionError(f"{path}: cannot read the log: {error.strerror}") from None
    return found


def _take_metadata(record: Metadata, found: dict[str, dict[str, str]]) -> bool:
    """Unless it is damaged, or there already; whether it is sound. Logs of older versions have no checksum."""
    values = {key: value for key, value in record.metadata.items() if key != CHECKSUM}
    is_sound = bool(record.metadata.get(CHECKSUM, checksum_of(values)) == checksum_of(values))
    if is_sound:
        found.setdefault(record.name, values)
    return is_sound


def is_foreign_log(path: Path) -> bool:
    """Whether another program wrote a file: its header says so, or, where that is lost, none of its topics is ours.
    Raises CompanionError for what is no log."""
    scan = LogScan(path)
    ours = {(stream.topic, stream.encoding) for stream in (CSI, POSE_IN, NEIGHBOUR)}
    found = {(message.topic, message.encoding) for message in scan}
    return not scan.is_own and (scan.has_header or bool(found)) and not ours & found


def _why_no_log(path: Path) -> str:
    """Why a file without our metadata has none."""
    with open_regular(path) as file:
        magic = file.read(MAGIC_BYTES)
        if not magic:
            return EMPTY
        _refuse_changed_ends(path, magic)
        scan = RecordScan(file)
        is_own = any(isinstance(record, Header) and record.library == LIBRARY for record in scan)
        if magic != MCAP0_MAGIC[: len(magic)] and not scan.chunks:
            return _no_mcap(path)
        if is_own or not scan.is_whole:
            return f"cut off or damaged: its metadata {METADATA!r} cannot be read"
    return f"no log of this program (it has no metadata {METADATA!r})"


def _refuse_changed_ends(path: Path, magic: bytes) -> None:
    """Raises CompanionError for a file of which no repair saves anything."""
    if magic.startswith(_LINE_ENDS_CHANGED):
        raise CompanionError(f"{path}: a transfer in text mode changed its line ends; copy it again, in binary mode")


def _no_mcap(path: Path) -> str:
    """What a file is that begins otherwise."""
    with open_regular(path) as file:
        start = file.read(_FIRST_BYTES)
    what = foreign_format(start)
    if what in ("", TEXT):
        what = f"it begins with {start[:MAGIC_BYTES]!r}"
    return f"not an MCAP log: {what}"


@contextmanager
def understood(path: Path) -> Iterator[None]:
    """What comes of a message that is not what its topic says becomes a CompanionError: the bytes were written so."""
    try:
        yield
    except _NOT_UNDERSTOOD as error:
        what = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise CompanionError(f"{path}: holds a message that this program does not write ({what})") from error


_NOT_UNDERSTOOD: Final = (
    msgspec.MsgspecError, ProtobufDecodeError, struct.error, LookupError, TypeError, ValueError, ArithmeticError,
    AttributeError, AssertionError, RecursionError, MemoryError,
)  # fmt: skip


def _first_of(path: Path) -> Path:
    """log.mcap of log.3.mcap."""
    stem, _, number = path.stem.rpartition(".")
    return path.with_name(stem + path.suffix) if stem and number.isdigit() else path
