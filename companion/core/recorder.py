"""Where the service puts its messages: the protocol alone, so that nobody who records stands above MCAP."""

from __future__ import annotations

from typing import Any, Protocol

from companion.core.streams import Stream


class Recorder(Protocol):
    """Where the service puts its messages."""

    @property
    def failed(self) -> bool:
        """Whether messages are lost now."""

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        """Takes one message of `stream`, whose own time is `t_mono_ns`. Neither blocks nor raises."""

    def counters(self) -> dict[str, int]:
        """For health."""
