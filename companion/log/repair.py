"""A log that was cut off, or damaged, made whole: what can be read, with an index."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from companion.errors import CompanionError
from companion.log.reader import LoggedMessage, LogScan, Progress, metadata_of
from companion.log.writer import METADATA, LogWriter


@dataclass(frozen=True, slots=True)
class Repair:
    """What was saved. `was_whole` when there was nothing to repair; `damaged` places could not be read."""

    messages: int
    was_whole: bool
    damaged: int


def repair(source: Path, target: Path, progress: Progress | None = None) -> Repair:
    """Copies all readable messages. Raises CompanionError; never touches `source`, nor a `target` that is there."""
    metadata = metadata_of(source)
    scan = LogScan(source, progress=progress)
    count = 0
    try:
        with target.open("xb") as file:
            writer = LogWriter(file, metadata.get(METADATA, {}))
            for name, values in metadata.items():
                if name != METADATA:
                    writer.add_metadata(name, values)
            for message in scan:
                copy(writer, message)
                count += 1
            writer.finish()
    except FileExistsError:
        raise CompanionError(f"{target}: is there already; choose another name with --out") from None
    except OSError as error:
        raise CompanionError(f"{target}: cannot be written: {error.strerror}") from None
    except CompanionError:
        target.unlink()
        raise
    return Repair(count, scan.is_whole, scan.damaged)


def copy(writer: LogWriter, message: LoggedMessage, prefix: str = "", offset_ns: int = 0) -> None:
    """One message as it is, under another topic and time if given."""
    times_ns = (max(0, message.log_time_ns + offset_ns), max(0, message.publish_time_ns + offset_ns))
    topic = prefix + message.topic
    writer.copy(topic, message.encoding, message.schema, times_ns, message.sequence, message.data)
