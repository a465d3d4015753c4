"""The live server of a running service: its process started, fed, and started again when it is gone. Nothing waits."""

from __future__ import annotations

import asyncio
import importlib.util
from typing import Final

import msgspec

from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.errors import ConfigError
from companion.host.beside import Beside
from companion.host.fed_process import keep_fed
from companion.host.token import read_token
from companion.log.live import LiveFeed

LIVE: Final = "companion.live.server"
"""Its module: a process of its own, of a room that nothing here imports."""
_EXTRA: Final = "foxglove.enabled: needs the library foxglove-sdk: pip install 'wsr-companion[foxglove]'"


class LiveStreams:
    """`recorder` is what the service records with: it tells viewers too, where there is a server.

    Raises ConfigError when the library is not there, or the token cannot be read.
    """

    def __init__(self, config: Config, clock: EventClock, recorder: Recorder) -> None:
        self._config = config
        self._feed: LiveFeed | None = None
        self._server = Beside("live server")
        self.recorder = recorder
        if config.foxglove.enabled:
            if importlib.util.find_spec("foxglove") is None:
                raise ConfigError(_EXTRA)
            if config.foxglove.token_file is not None:
                read_token(config.path(config.foxglove.token_file))
            self.recorder = self._feed = LiveFeed(recorder, clock)

    @property
    def feed(self) -> LiveFeed | None:
        return self._feed

    def start(self) -> None:
        """From now on, beside the service's tasks and not one of them."""
        if self._feed is not None:
            self._server.start(self._run(self._feed))

    async def aclose(self) -> None:
        """Harmless when repeated."""
        await self._server.aclose()

    async def _run(self, feed: LiveFeed) -> None:
        feed.start()
        try:
            await keep_fed("live server", LIVE, self._settings(), feed.attach)
        finally:
            await asyncio.to_thread(feed.close)

    def _settings(self) -> str:
        config, live = self._config, self._config.foxglove
        token = None if live.token_file is None else str(config.path(live.token_file))
        settings = {"name": config.name, "address": live.address, "port": live.port, "token_file": token}
        return msgspec.json.encode(settings).decode()
