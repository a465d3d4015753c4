"""Who may look at a live server that knows no passwords: WebSockets are handed on for who knows the word."""

from __future__ import annotations

import asyncio
from typing import Final

from aiohttp import ClientError, ClientSession, WSMsgType, web

from companion.host.token import is_token

_MOST: Final = 8
"""Viewers at once."""
_LARGEST: Final = 4 << 20


class Front:
    """Before the server at `port` of loopback."""

    def __init__(self, token: str, port: int) -> None:
        self._token = token
        self._inner = f"ws://127.0.0.1:{port}/"
        self._viewers = 0

    def application(self) -> web.Application:
        app = web.Application(client_max_size=4096)
        app.router.add_get("/{any:.*}", self._view)
        return app

    async def _view(self, request: web.Request) -> web.StreamResponse:
        kind, _, bearer = request.headers.get("Authorization", "").partition(" ")
        given = bearer.strip() if kind.lower() == "bearer" else request.query.get("token", "")
        if not is_token(given, self._token):
            raise web.HTTPUnauthorized(text="open ws://HOST:PORT/?token=WORD (foxglove.token_file)\n")
        if self._viewers >= _MOST:
            raise web.HTTPServiceUnavailable(text=f"{_MOST} viewers look already\n")
        asked = [word.strip() for word in request.headers.get("Sec-WebSocket-Protocol", "").split(",") if word.strip()]
        self._viewers += 1
        try:
            async with ClientSession() as session:
                try:
                    inner = await session.ws_connect(self._inner, protocols=asked, max_msg_size=_LARGEST)
                except ClientError:
                    raise web.HTTPBadGateway(text="the viewer speaks another protocol\n") from None
                outer = web.WebSocketResponse(protocols=asked, max_msg_size=_LARGEST, compress=False)
                await outer.prepare(request)
                ways = [asyncio.create_task(_pump(inner, outer)), asyncio.create_task(_pump(outer, inner))]
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
                for way in ways:
                    way.cancel()
                await asyncio.wait(ways)
                await inner.close()
                await outer.close()
                return outer
        finally:
            self._viewers -= 1


async def _pump(source: object, target: object) -> None:
    """Until either is closed."""
    async for message in source:  # type: ignore[attr-defined]
        if message.type is WSMsgType.TEXT:
            await target.send_str(message.data)  # type: ignore[attr-defined]
        elif message.type is WSMsgType.BINARY:
            await target.send_bytes(message.data)  # type: ignore[attr-defined]
        else:
            return
