"""A page as it is served, without its process."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from aiohttp import ClientResponse, ClientSession, CookieJar
from aiohttp.test_utils import TestServer

from companion.page.server import PageServer, PageSettings
from companion.page.viewers import Viewers
from tests.page_messages import known

WORD = "q7Zk1mVh0pXw3uTs"


@asynccontextmanager
async def page(token: str | None = None, control: Path | None = None) -> AsyncIterator[tuple[Viewers, TestServer]]:
    settings = PageSettings(address="127.0.0.1", port=0, control_socket=None if control is None else str(control))
    viewers = Viewers()
    viewers.take({"topic": "introduction", "t_ns": 0, "data": known()})
    server = TestServer(PageServer(settings, token, viewers).application())
    await server.start_server()
    pictures = asyncio.create_task(viewers.run())
    try:
        yield viewers, server
    finally:
        pictures.cancel()
        await server.close()


@asynccontextmanager
async def asking(server: TestServer) -> AsyncIterator[ClientSession]:
    async with ClientSession(base_url=server.make_url("/"), cookie_jar=CookieJar(unsafe=True)) as session:
        yield session


async def events(answer: ClientResponse) -> AsyncIterator[tuple[str, Any]]:
    buffer = b""
    async for part in answer.content.iter_any():
        *events, buffer = (buffer + part).split(b"\n\n")
        for event in events:
            lines = dict(line.split(b": ", 1) for line in event.split(b"\n"))
            yield lines[b"event"].decode(), json.loads(lines[b"data"])
