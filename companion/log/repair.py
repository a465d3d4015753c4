"""A log that was cut off, or damaged, made whole: what can be read, with an index."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from companion.errors import CompanionError
from companion.log.reader import EMPTY, LoggedMessage, LogScan, Progress, is_foreign_log, metadata_of, refuse_joined
from companion.log.writer import METADATA, LogWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class Repair:
    """What was saved. `was_whole` when there was nothing to repair; `damaged` places could not be read, `lost_bytes` in
    all; without `is_replayable` configuration and clock are among them."""

    messages: int
    was_whole: bool
    damaged: int
    lost_bytes: int
    is_replayable: bool


def repair(source: Path, target: Path, progress: Progress | None = None) -> Repair:
    """Copies all readable messages. Raises CompanionError; never touches `source`, nor a `target` that is there, and
    leaves no target that is not whole. What another program wrote is refused: only of our own logs this copies all."""
    metadata = metadata_of(source)
    if METADATA not in metadata and is_foreign_log(source):
        raise CompanionError(
            f"{source}: no log of this program; attachments and channel metadata of other programs would be lost; "
            "`mcap recover` of the mcap tool keeps them"
        )
    scan = LogScan(source, progress=progress)
    with new_log(target, metadata.get(METADATA, {})) as writer:
        for name, values in metadata.items():
            if name != METADATA:
                writer.add_metadata(name, values)
        count = 0
        for message in scan:
            copy(writer, message)
            count += 1
        refuse_joined(scan)
        if not count and METADATA not in metadata:
            why = "neither a message nor its configuration is there" if scan.size_bytes else EMPTY
            raise CompanionError(f"{source}: nothing could be saved: {why}")
    return Repair(
        messages=count,
        was_whole=scan.is_whole,
        damaged=scan.damaged,
        lost_bytes=scan.lost_bytes,
        is_replayable=METADATA in metadata,
    )


@contextmanager
def new_log(target: Path, metadata: Mapping[str, str]) -> Iterator[LogWriter]:
    """A new log, which is finished at the end and removed if that is not reached. Raises CompanionError."""
    made = False
    try:
        with target.open("xb") as file:
            made = True
            writer = LogWriter(file, metadata)
            yield writer
            writer.finish()
            made = False
    except FileExistsError:
        raise CompanionError(f"{target}: is there already; choose another name with --out") from None
    except OSError as error:
        raise CompanionError(f"{target}: cannot be written: {error.strerror}") from None
    finally:
        if made:
            target.unlink(missing_ok=True)


def copy(writer: LogWriter, message: LoggedMessage, prefix: str = "", offset_ns: int = 0) -> None:
    """One message as it is, under another topic and time if given."""
    times_ns = (max(0, message.log_time_ns + offset_ns), max(0, message.publish_time_ns + offset_ns))
    topic = prefix + message.topic
    writer.copy(topic, message.encoding, message.schema, times_ns, sequence=message.sequence, data=message.data)
