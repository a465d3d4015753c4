"""Messages of MCAP logs, in file order, from whole and from truncated files, and from all parts of a recording."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from companion.config.file import config_of
from companion.config.schema import Config
from companion.errors import CompanionError
from companion.log.parts import parts_beside
from companion.log.scan import UNREADABLE, RecordScan
from companion.log.writer import METADATA

_NO_SCHEMA: Final = ("", "", b"")
Progress = Callable[[int, int], None]
"""Called with the bytes read and the bytes there are."""


@dataclass(frozen=True, slots=True)
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
        self.size_bytes = 0
        self._topics = topics
        self._progress = progress
        self._past_damage = past_damage

    def __iter__(self) -> Iterator[LoggedMessage]:
        try:
            with self.path.open("rb") as file:
                self.size_bytes = self.path.stat().st_size
                magic = file.read(len(MCAP0_MAGIC))
                if magic != MCAP0_MAGIC[: len(magic)]:
                    raise CompanionError(f"{self.path}: not an MCAP log: it begins with {magic!r}")
                if len(magic) < len(MCAP0_MAGIC):
                    return  # cut off before the first record
                file.seek(0)
                records = RecordScan(file, self._past_damage)
                yield from self._messages(records, file)
                self.is_whole, self.damaged = records.is_whole, records.damaged
        except OSError as error:
            raise CompanionError(f"{self.path}: cannot read the log: {error.strerror}") from None

    def _messages(self, records: RecordScan, file: BinaryIO) -> Iterator[LoggedMessage]:
        channels: dict[int, Channel] = {}
        schemas: dict[int, tuple[str, str, bytes]] = {0: _NO_SCHEMA}
        has_learned = False
        for record in records:
            match record:
                case Schema():
                    schemas[record.id] = (record.name, record.encoding, record.data)
                case Channel():
                    channels[record.id] = record
                case Metadata():
                    self.metadata[record.name] = record.metadata
                case Message():
                    if record.channel_id not in channels and not has_learned:  # it was told in a chunk that is damaged
                        has_learned = True
                        self._learn_from_all(channels, schemas)
                    channel = channels.get(record.channel_id)
                    if channel is None or (self._topics is not None and channel.topic not in self._topics):
                        continue
                    if self._progress is not None:
                        self._progress(file.tell(), self.size_bytes)
                    yield LoggedMessage(
                        channel.topic,
                        record.log_time,
                        record.data,
                        record.publish_time,
                        record.sequence,
                        channel.message_encoding,
                        schemas.get(channel.schema_id, _NO_SCHEMA),
                    )

    def _learn_from_all(self, channels: dict[int, Channel], schemas: dict[int, tuple[str, str, bytes]]) -> None:
        """Channels and schemas from wherever they can be read: the end of a finished file tells all of them again."""
        with self.path.open("rb") as file:
            for record in RecordScan(file):
                match record:
                    case Schema():
                        schemas.setdefault(record.id, (record.name, record.encoding, record.data))
                    case Channel():
                        channels.setdefault(record.id, record)


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
        """Log time less the service's monotonic time."""
        return int(self.metadata["wall_minus_mono_ns"])

    def config(self) -> Config:
        """The configuration the service ran with. Raises CompanionError when there is none, or this version cannot
        read it."""
        if "config" not in self.metadata:
            role = self.metadata.get("role", "unknown")
            raise CompanionError(
                f"{self.paths[0]}: a log of role {role} holds no configuration; expected a flight's log"
            )
        return config_of(msgspec.json.decode(self.metadata["config"]), f"{self.paths[0]}: its configuration")

    def messages(
        self,
        topics: Container[str] | None = None,
        progress: Progress | None = None,
        on_cut: Callable[[Path], None] | None = None,
        past_damage: bool = True,
    ) -> Iterator[LoggedMessage]:
        """Of all parts in their order. `on_cut` is told of each file that is cut off or damaged. Without `past_damage`
        the first damage ends it."""
        total = sum(path.stat().st_size for path in self.paths)
        done = 0
        for path in self.paths:
            before = done

            def read(at: int, _: int, before: int = before) -> None:
                if progress is not None:
                    progress(before + at, total)

            scan = LogScan(path, topics, read, past_damage)
            yield from scan
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
    parts = {int(metadata.get("part", "0")): (path, metadata)}
    for beside in parts_beside(_first_of(path)):
        found = metadata_of(beside).get(METADATA, {})
        if session is not None and found.get("session") == session:
            parts.setdefault(int(found["part"]), (beside, found))
    numbers = sorted(parts)
    gap = next((number for number in range(numbers[0], numbers[-1]) if number not in parts), None)
    if gap is not None:
        raise CompanionError(f"{path}: part {gap} of its recording is missing beside it")
    return Session(tuple(parts[n][0] for n in numbers), parts[numbers[0]][1], numbers[0])


def metadata_of(path: Path) -> dict[str, dict[str, str]]:
    """The metadata records at the start of a file, without reading the rest; empty for what is no log."""
    found: dict[str, dict[str, str]] = {}
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, emit_chunks=True).records:
                if isinstance(record, Metadata):
                    found[record.name] = record.metadata
                elif found:
                    break
    except OSError as error:
        raise CompanionError(f"{path}: cannot read the log: {error.strerror}") from None
    except UNREADABLE:
        return found
    return found


def _why_no_log(path: Path) -> str:
    """Why a file without our metadata has none."""
    with path.open("rb") as file:
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC[: len(magic)]:
            return f"not an MCAP log: it begins with {magic!r}"
        if not magic:
            return "empty; nothing was written to it"
        try:
            for _ in StreamReader(file, skip_magic=True, emit_chunks=True).records:
                pass
        except UNREADABLE:
            return f"cut off or damaged in its first bytes: its metadata {METADATA!r} cannot be read"
    return f"no log of this program (it has no metadata {METADATA!r})"


def _first_of(path: Path) -> Path:
    """log.mcap of log.3.mcap."""
    stem, _, number = path.stem.rpartition(".")
    return path.with_name(stem + path.suffix) if stem and number.isdigit() else path
