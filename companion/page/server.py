"""The page's own process: a feed on standard input, HTTP out, until the feed ends.

Started by `python -m companion.page.server SETTINGS`, `PageSettings` as JSON. Says on standard output where it
listens, and when somebody looks for the first time, one line each. It may be killed, stopped or flooded: whoever feeds
it does not wait.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import socket
import sys
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import msgspec
from aiohttp import web

from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.host.fed_process import take_feed
from companion.host.token import read_token
from companion.page import access
from companion.page.metrics import CONTENT_TYPE, metrics_text
from companion.page.viewers import Viewers

"""Datagrams taken before others have their turn."""
_DISK_S: Final = 5.0
_ENGAGE_S: Final = 20.0
_SILENT_S: Final = 5.0
"""A service that says nothing for longer is not healthy."""
_ASSETS: Final = {
    "/": ("page.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/colours.js": ("colours.js", "text/javascript"),
    "/draw.js": ("draw.js", "text/javascript"),
    "/panels.js": ("panels.js", "text/javascript"),
    "/live.js": ("live.js", "text/javascript"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSettings:
    """What the process is told by whoever starts it."""

    address: str
    port: int
    token_file: str | None = None
    control_socket: str | None = None
    """Where commands go; without it the page has none."""


class PageServer:
    """The routes of one page."""

    def __init__(self, settings: PageSettings, token: str | None, viewers: Viewers) -> None:
        self._token = token
        self._control = None if settings.control_socket is None else Path(settings.control_socket)
        self._viewers = viewers

    def application(self) -> web.Application:
        app = web.Application(middlewares=[access.guard(self._token)], client_max_size=4096)
        app.on_response_prepare.append(access.add_headers)
        for path in _ASSETS:
            app.router.add_get(path, self._asset)
        app.router.add_get("/events", self._events)
        app.router.add_get("/state", self._state)
        app.router.add_get("/metrics", self._metrics)
        app.router.add_get("/healthz", self._healthz)
        app.router.add_post("/command/{name}", self._command)
        return app

    async def _asset(self, request: web.Request) -> web.Response:
        name, kind = _ASSETS[request.path]
        if request.path == "/":
            self._viewers.note_visit()
        return web.Response(text=asset(name), content_type=kind, charset="utf-8")

    async def _events(self, request: web.Request) -> web.StreamResponse:
        return await self._viewers.serve(request, {"may_command": self._control is not None})

    async def _state(self, request: web.Request) -> web.Response:
        model = self._viewers.model
        state = {"view": model.view(self._viewers.silent_s()), "path": model.path(), "profile": model.profile}
        return web.Response(body=msgspec.json.encode(state), content_type="application/json")

    async def _metrics(self, request: web.Request) -> web.Response:
        viewers = self._viewers
        dropped = viewers.model.counts.get("dropped", 0)
        text = metrics_text(viewers.model, viewers.silent_s(), viewers.count, dropped)
        return web.Response(body=text.encode(), headers={"Content-Type": CONTENT_TYPE})

    async def _healthz(self, request: web.Request) -> web.Response:
        """Whether the service speaks, and nothing more: it is open to everybody who reaches the page."""
        is_well = bool(self._viewers.model.known) and self._viewers.silent_s() < _SILENT_S
        return web.Response(text="ok\n" if is_well else "the service is silent\n", status=200 if is_well else 503)

    async def _command(self, request: web.Request) -> web.Response:
        name = request.match_info["name"]
        if self._control is None or self._token is None:
            raise web.HTTPForbidden(text="this page commands nothing (page.allow_engage)\n")
        if name not in ("engage", "abort"):
            raise web.HTTPNotFound(text="known: engage, abort\n")
        if not access.is_own_command(request):
            raise web.HTTPForbidden(text=f"a command comes from the page itself, with {access.COMMAND_HEADER}\n")
        try:
            asking = asyncio.ensure_future(ask(self._control, name, _ENGAGE_S, request.query.get("target")))
            answer = await (asyncio.shield(asking) if name == "abort" else asking)  # an abort is for who has left too
        except CompanionError as error:
            answer = {"ok": False, "error": str(error)}
        shown = {key: answer[key] for key in ("ok", "error", "vehicle", "target") if key in answer}
        return web.json_response(shown, status=200 if answer.get("ok") else 409)


def asset(name: str) -> str:
    """One of the files that a browser is given."""
    return resources.files("companion.page").joinpath("assets", name).read_text("utf-8")


def main() -> None:
    settings = msgspec.json.decode(sys.argv[1], type=PageSettings)
    with socket.socket(fileno=os.dup(0)) as feed:
        feed.setblocking(False)
        try:
            asyncio.run(_serve(settings, feed))
        except CompanionError as error:
            print(f"companion page: {error}", file=sys.stderr, flush=True)
            sys.exit(error.exit_code)


async def _serve(settings: PageSettings, feed: socket.socket) -> None:
    """Until the feed ends. Raises CompanionError when the port cannot be had."""
    token = None if settings.token_file is None else read_token(Path(settings.token_file))
    viewers = Viewers(lambda: _say({"seen": True}))
    runner = web.AppRunner(
        PageServer(settings, token, viewers).application(), access_log=None, shutdown_timeout=1.0, keepalive_timeout=30,
        handler_cancellation=True,  # who has left does not engage any more
    )  # fmt: skip
    await runner.setup()
    try:
        await web.TCPSite(runner, settings.address, settings.port, reuse_address=True).start()
    except OSError as error:
        raise CompanionError(f"port {settings.port} at {settings.address}: {error.strerror}") from None
    _say({"listening": f"http://{settings.address}:{runner.addresses[0][1]}/"})
    async with asyncio.TaskGroup() as tasks:
        others = [tasks.create_task(viewers.run()), tasks.create_task(_watch_disk(viewers))]
        await take_feed(feed, lambda data: viewers.take(json.loads(data)))
        for task in others:
            task.cancel()
    await runner.cleanup()


async def _watch_disk(viewers: Viewers) -> None:
    """How much is left where the log is. A disk that hangs holds up a thread of this process, and nothing else."""
    while True:
        log = viewers.model.known.get("log")
        if log and viewers.model.known.get("source") == "live":
            viewers.model.free_mib = await asyncio.to_thread(_free_mib, Path(log).parent)
        await asyncio.sleep(_DISK_S)


def _free_mib(folder: Path) -> float | None:
    try:
        return shutil.disk_usage(folder).free / (1 << 20)
    except OSError:
        return None


def _say(line: dict[str, Any]) -> None:
    try:
        print(json.dumps(line), flush=True)
    except OSError:  # nobody listens; what is left of it must not fail again at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


if __name__ == "__main__":
    main()
