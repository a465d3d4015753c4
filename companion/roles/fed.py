"""A process that shows the service to others: started, fed, and started again when it is gone. Nothing waits for it."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

from companion.config.schema import Config
from companion.core.clock import NS_PER_S, next_beat_ns
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.host.beside import Beside
from companion.host.fed_process import keep_fed
from companion.log.feed import STATUS, Feed, introduction
from companion.log.lines import record_lines

_STATUS_NS: Final = NS_PER_S
"""On the beat of the service's own health, which needs the same of what is known."""


class FedProcess(ABC):
    """`recorder` is what the service records with: it tells the process too, where there is one.

    A process of its own, of a room that nothing here imports.
    """

    name: str
    module: str

    def __init__(self, config: Config, clock: EventClock, recorder: Recorder, enabled: bool) -> None:
        self._config = config
        self._clock = clock
        self._feed: Feed | None = None
        self._beside = Beside(self.name)
        self.recorder = recorder
        if enabled:
            self.recorder = self._feed = Feed(introduction(config, "live"), recorder)

    @abstractmethod
    def settings(self) -> str:
        """What the process is told when it is started, as JSON."""

    def start(self, status: Callable[[], dict[str, Any]]) -> None:
        """From now on, beside the service's tasks and not one of them: one that fails ends nothing but itself.
        `status` is asked once a second, on the event loop."""
        if self._feed is not None:
            self._beside.start(self._run(self._feed, status))

    async def aclose(self) -> None:
        """Harmless when repeated."""
        await self._beside.aclose()

    async def _run(self, feed: Feed, status: Callable[[], dict[str, Any]]) -> None:
        feed.start()
        lines = record_lines(_ForFeed(feed))
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(
                    keep_fed(self.name, self.module, self.settings(), feed.attach), name=f"{self.name} process"
                )
                tasks.create_task(self._tell(feed, status), name=f"{self.name} status")
        finally:
            logging.getLogger().removeHandler(lines)
            await asyncio.to_thread(feed.close)

    async def _tell(self, feed: Feed, status: Callable[[], dict[str, Any]]) -> None:
        while True:
            feed.tell(STATUS, self._clock.now_ns(), status())
            await self._clock.sleep_until_ns(next_beat_ns(self._clock.now_ns(), _STATUS_NS))


class _ForFeed:
    """The feed as a Recorder of log lines, which the log has by itself."""

    failed = False

    def __init__(self, feed: Feed) -> None:
        self._feed = feed

    def record(self, stream: Any, t_mono_ns: int, message: Any) -> None:
        self._feed.note(stream, t_mono_ns, message)

    def counters(self) -> dict[str, int]:
        return {}
