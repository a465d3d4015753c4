"""FeitCSI logs: header, data, header, data .. read whole."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from csi_bridge.feitcsi.parser import FeitLogParser, next_record_at, record_size
from csi_bridge.feitcsi.records import HEADER_BYTES, FeitRecord
from csi_bridge.records import CsiError


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeitLog:
    """All records of a log in file order, and where each begins."""

    path: Path
    records: tuple[FeitRecord, ...]
    offsets: tuple[int, ...]
    damaged_count: int
    """Places where no record stood though one had to."""
    skipped_bytes: int
    """Passed over to find the next record."""
    truncated_bytes: int
    """Of a record cut off by the end of the file."""

    def __len__(self) -> int:
        return len(self.records)

    @property
    def without_record(self) -> str:
        """What to say of a log in which nothing is whole."""
        return (
            f"{self.path}: a FeitCSI log without a whole record: {self.truncated_bytes} bytes of one that is cut off, "
            f"{self.skipped_bytes} of none"
        )


def is_feitcsi(data: bytes) -> bool:
    """Whether a log that begins with these bytes, a thousand or more, is one of FeitCSI. Damage at the very beginning
    does not hide it."""
    try:
        record_size(data[:HEADER_BYTES])
    except CsiError:
        found = next_record_at(data)
        return found + HEADER_BYTES <= len(data)
    return True


def parse_log(data: bytes, path: Path) -> FeitLog:
    """Every record in `data`; `path` is for messages."""
    parser = FeitLogParser()
    parser.feed(data)
    found, damaged = parser.take_whole()
    lost = parser.pending_bytes if parser.is_lost else 0
    return FeitLog(
        path=path,
        records=tuple(record for _, record in found),
        offsets=tuple(offset for offset, _ in found),
        damaged_count=damaged,
        skipped_bytes=parser.skipped_bytes + lost,
        truncated_bytes=parser.pending_bytes - lost,
    )
