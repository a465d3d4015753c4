"""Where a part's results go: it gives them to whoever was connected, in the order of connection."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Output(Generic[T]):
    """What a part makes. `connect` belongs to the wiring, before anything flows; nobody need listen."""

    def __init__(self) -> None:
        self._sinks: list[Callable[[T], object]] = []

    def connect(self, *sinks: Callable[[T], object]) -> None:
        self._sinks += sinks

    def give(self, item: T) -> None:
        """Each sink has done with it before the next gets it."""
        for sink in self._sinks:
            sink(item)
