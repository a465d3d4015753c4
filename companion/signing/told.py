"""What service and relay tell each other, as JSON: settings at the start, counts twice a second."""

from __future__ import annotations

import msgspec


class RelaySettings(msgspec.Struct, frozen=True, kw_only=True):
    """What the service gives."""

    url: str
    port: int
    """Of MAVSDK, on 127.0.0.1."""
    key_file: str
    state_dir: str
    system_id: int = 1


class RelayReport(msgspec.Struct, frozen=True, kw_only=True):
    """What the relay tells: its counts since its start."""

    taken: int = 0
    unsigned: int = 0
    wrong: int = 0
    used: int = 0
    unsent: int = 0
    old: int = 0
    """Dropped for their age, both ways."""
    sent: int = 0
    slowest_s: float = 0.0
    """Longest that a frame took through here since the last report."""
    book_failed: bool = False
