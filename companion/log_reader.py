"""Messages of an MCAP log, in file order, from whole and from truncated files."""

from __future__ import annotations

import struct
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path

import zstandard
from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from companion.errors import CompanionError

# What the reader raises where a file ends in mid record, in mid chunk or in mid number.
_CUT = (McapError, struct.error, zstandard.ZstdError, UnicodeDecodeError)


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """One message as recorded; `data` is JSON or raw bytes as its stream says."""

    topic: str
    log_time_ns: int
    data: bytes


def read_log(path: Path, topics: Container[str]) -> list[LoggedMessage]:
    """All messages of `topics`. A file that ends in mid record gives what stands before. Raises CompanionError."""
    messages: list[LoggedMessage] = []
    channels: dict[int, str] = {}
    try:
        with path.open("rb") as file:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message) and channels[record.channel_id] in topics:
                    messages.append(LoggedMessage(channels[record.channel_id], record.log_time, record.data))
    except OSError as error:
        raise CompanionError(f"{path}: cannot read the log: {error.strerror}") from None
    except InvalidMagic as error:
        raise CompanionError(f"{path}: not a readable MCAP log: {error}") from None
    except _CUT:
        return messages
    return messages
