"""A recorder that keeps what it is given, in order."""

from __future__ import annotations

from typing import Any

from companion.core.streams import Stream


class Kept:
    """A `companion.core.recorder.Recorder`."""

    failed = False

    def __init__(self) -> None:
        self.messages: list[tuple[Stream, int, Any]] = []

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        self.messages.append((stream, t_mono_ns, message))

    def counters(self) -> dict[str, int]:
        return {"written": len(self.messages)}

    @property
    def topics(self) -> list[str]:
        return [stream.topic for stream, _, _ in self.messages]
