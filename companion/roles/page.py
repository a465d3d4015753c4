"""The page of a running service: its process started, fed, and started again when it is gone. Nothing waits for it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import sys
from collections.abc import Callable
from typing import Any, Final

import msgspec

from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.host.child import tied
from companion.host.token import read_token
from companion.log.feed import STATUS, Feed, introduction
from companion.log.lines import record_lines

_log = logging.getLogger(__name__)
_STATUS_S: Final = 1.0
_FIRST_WAIT_S: Final = 1.0
_LONGEST_WAIT_S: Final = 30.0
_LASTED_S: Final = 60.0
"""A page that has lived for so long is started again at once when it goes."""
PAGE: Final = "companion.page.server"
"""Its module: a process of its own, of a room that nothing here imports."""


class Page:
    """`recorder` is what the service records with: it tells the page too, where there is one.

    Raises ConfigError when the token cannot be read.
    """

    def __init__(self, config: Config, clock: EventClock, recorder: Recorder) -> None:
        self._config = config
        self._clock = clock
        self._feed: Feed | None = None
        self._task: asyncio.Task[None] | None = None
        self.recorder = recorder
        if config.page.enabled:
            if config.page.token_file is not None:
                read_token(config.path(config.page.token_file))
            self.recorder = self._feed = Feed(introduction(config, "live"), recorder)

    def start(self, status: Callable[[], dict[str, Any]]) -> None:
        """From now on, beside the service's tasks and not one of them: a page that fails ends nothing but itself.
        `status` is asked once a second, on the event loop."""
        if self._feed is not None:
            self._task = asyncio.create_task(self._run(self._feed, status), name="page")
            self._task.add_done_callback(_tell_failure)

    async def aclose(self) -> None:
        """Harmless when repeated."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})

    async def _run(self, feed: Feed, status: Callable[[], dict[str, Any]]) -> None:
        feed.start()
        lines = record_lines(_ForPage(feed))
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._keep(feed), name="page process")
                tasks.create_task(self._tell(feed, status), name="page status")
        finally:
            logging.getLogger().removeHandler(lines)
            await asyncio.to_thread(feed.close)

    async def _tell(self, feed: Feed, status: Callable[[], dict[str, Any]]) -> None:
        while True:
            feed.tell(STATUS, self._clock.now_ns(), status())
            await asyncio.sleep(_STATUS_S)

    async def _keep(self, feed: Feed) -> None:
        """Never ends and never fails: a page is worth no flight."""
        loop, wait_s = asyncio.get_running_loop(), _FIRST_WAIT_S
        while True:
            begun_s = loop.time()
            try:
                code = await self._serve(feed)
                _log.warning("the page's process ended with code %d; starting another", code)
            except OSError as error:
                _log.warning("the page's process cannot be started: %s", error.strerror)
            wait_s = _FIRST_WAIT_S if loop.time() - begun_s > _LASTED_S else min(2 * wait_s, _LONGEST_WAIT_S)
            await asyncio.sleep(wait_s)

    async def _serve(self, feed: Feed) -> int:
        """One process, until it ends; its exit code. Raises OSError."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            command = tied("nice", "-n", "5", sys.executable, "-m", PAGE, self._settings())
            try:
                process = await asyncio.create_subprocess_exec(
                    *command, stdin=theirs.fileno(), stdout=asyncio.subprocess.DEVNULL
                )
            except BaseException:
                ours.close()
                raise
        try:
            await asyncio.to_thread(feed.attach, ours)
            return await process.wait()
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    def _settings(self) -> str:
        config, page = self._config, self._config.page
        token = None if page.token_file is None else str(config.path(page.token_file))
        control = str(config.path(config.control_socket)) if page.allow_engage else None
        settings = {"address": page.address, "port": page.port, "token_file": token, "control_socket": control}
        return msgspec.json.encode(settings).decode()


def _tell_failure(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        _log.error("the page has failed: %r; the service goes on without it", error)


class _ForPage:
    """The feed as a Recorder of log lines, which the log has by itself."""

    failed = False

    def __init__(self, feed: Feed) -> None:
        self._feed = feed

    def record(self, stream: Any, t_mono_ns: int, message: Any) -> None:
        self._feed.note(stream, t_mono_ns, message)

    def counters(self) -> dict[str, int]:
        return {}
