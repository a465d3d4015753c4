"""Where live CSI comes from: the kernel's netlink connector, or a Unix socket with the same bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(slots=True)
class SourceCounters:
    """What a source has seen since it was opened; owned by the source."""

    datagrams: int = 0
    """Read from the socket, whatever was in them."""
    malformed: int = 0
    """No connector message of our channel."""
    refused_sender: int = 0
    """Not sent by the kernel although that was demanded."""
    overruns: int = 0
    """Times the kernel reported that it had to drop records."""


class CsiSource(Protocol):
    """A non-blocking source of record bodies, for `loop.add_reader(source.fileno(), ...)`."""

    @property
    def counters(self) -> SourceCounters: ...

    @property
    def is_stamped(self) -> bool:
        """Whether `arrivals` tells when each record arrived, however late it is read."""
        ...

    def fileno(self) -> int: ...

    def arrivals(self, limit: int = 256) -> list[tuple[int, bytes, int | None]]:
        """What was gathered and at most `limit` more records (code, body, arrival); reads until the socket is empty
        otherwise. Never blocks.

        Arrival is on CLOCK_MONOTONIC [ns], None where it is not known: then a record came at the latest now.
        """
        ...

    def gather(self, limit: int = 256) -> int:
        """Reads at most `limit` records and keeps them for `arrivals`; how many datagrams those were."""
        ...

    def drain(self, limit: int = 256) -> list[tuple[int, bytes]]:
        """As `arrivals`, without their times."""
        ...

    def close(self) -> None: ...
