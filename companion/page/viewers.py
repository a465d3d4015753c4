"""Those who look: each gets the newest picture as fast as it takes it, and never faster than five times a second.

Server-sent events: `view` is what changes all the time, `path` and `profile` come when they are new, `page` says what
this page may do. A browser that is slow waits for itself alone, and sees fewer pictures; nothing queues for it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
from aiohttp import web

from companion.page.model import Model

PERIOD_S: Final = 0.2
_MOST: Final = 16
_QUIET_S: Final = 1.0
"""Without news a picture is sent this often, so that a browser knows that the line is there."""
_PATH_S: Final = 1.0
"""All of the way flown is sent this often at most; a view has where the vehicle is now."""
_TAKES_S: Final = 10.0
"""A browser that has not taken one for so long is let go; it comes back by itself."""
_RETRY_MS: Final = 1000


class Viewers:
    """Keeps the model and serves it. `on_first` is called when somebody looks for the first time."""

    def __init__(self, on_first: Callable[[], None] = lambda: None) -> None:
        self.model = Model()
        self.count = 0
        self._on_first = on_first
        self._is_seen = False
        self._told_s, self._told_ns = time.monotonic(), 0
        self._news = asyncio.Condition()
        self._view = b""
        self._path: tuple[int, bytes] = (-1, b"")
        self._path_made_s = -_PATH_S
        self._profile: tuple[int, bytes] = (-1, b"")
        self._number = 0

    def take(self, datagram: Mapping[str, Any]) -> None:
        """One datagram of the feed. Counts come by themselves: they are news only when the service's time goes on."""
        if datagram["topic"] != "counts" or datagram["t_ns"] > self._told_ns:
            self._told_s, self._told_ns = time.monotonic(), datagram["t_ns"]
        self.model.take(datagram["topic"], datagram["t_ns"], datagram["data"])

    def silent_s(self) -> float:
        """Since the service said anything, or its time went on."""
        return time.monotonic() - self._told_s

    def note_visit(self) -> None:
        if not self._is_seen:
            self._is_seen = True
            self._on_first()

    async def run(self) -> None:
        """Makes a picture when there are news and somebody looks, five times a second at most."""
        version, made_s = -1, 0.0
        while True:
            await asyncio.sleep(PERIOD_S)
            now_s = time.monotonic()
            if not self.count or (self.model.version == version and now_s - made_s < _QUIET_S):
                continue
            version, made_s = self.model.version, now_s
            self._make()
            async with self._news:
                self._news.notify_all()

    async def serve(self, request: web.Request, about: Mapping[str, Any]) -> web.StreamResponse:
        """Until the browser goes."""
        if self.count >= _MOST:
            raise web.HTTPServiceUnavailable(text=f"{_MOST} look already\n")
        response = web.StreamResponse(headers={"Content-Type": "text/event-stream; charset=utf-8"})
        await response.prepare(request)
        self.count += 1
        try:
            self._make()
            await self._send(response, b"retry: %d\n" % _RETRY_MS + _event("page", about))
            await self._follow(response)
        except (ConnectionError, TimeoutError):
            if request.transport is not None:
                request.transport.abort()  # what it has not taken is not waited for either
        finally:
            self.count -= 1
        return response

    async def _follow(self, response: web.StreamResponse) -> None:
        path = profile = number = -1
        while True:
            parts = []
            if self._profile[0] != profile:
                profile, data = self._profile
                parts.append(data)
            if self._path[0] != path:
                path, data = self._path
                parts.append(data)
            number = self._number
            await self._send(response, b"".join([*parts, self._view]))
            async with self._news:
                while self._number == number:
                    await self._news.wait()

    async def _send(self, response: web.StreamResponse, data: bytes) -> None:
        async with asyncio.timeout(_TAKES_S):
            await response.write(data)

    def _make(self) -> None:
        """One picture, for all who look."""
        model = self.model
        self._number += 1
        self._view = _event("view", model.view(self.silent_s()))
        now_s = time.monotonic()
        if self._path[0] != model.path_version and now_s - self._path_made_s >= _PATH_S:
            self._path_made_s = now_s
            self._path = model.path_version, _event("path", model.path())
        if self._profile[0] != model.profile_version:
            self._profile = model.profile_version, _event("profile", model.profile)


def _event(name: str, content: Any) -> bytes:
    return b"event: %s\ndata: %s\n\n" % (name.encode(), msgspec.json.encode(content))
