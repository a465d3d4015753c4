"""Before a live server: WebSockets are handed on for who knows the word, and for no more than there is room for."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest
from aiohttp import ClientSession, WSMsgType, WSServerHandshakeError, web
from aiohttp.test_utils import TestServer

from companion.live import front
from companion.live.front import Front

_WORD = "a-word-of-sixteen-letters"
_SPOKEN = "foxglove.sdk.v1"


async def _echo(request: web.Request) -> web.WebSocketResponse:
    """What stands behind: says everything again, and speaks one protocol."""
    if request.headers.get("Sec-WebSocket-Protocol") != _SPOKEN:
        raise web.HTTPBadRequest
    answer = web.WebSocketResponse(protocols=[_SPOKEN])
    await answer.prepare(request)
    async for message in answer:
        if message.type is WSMsgType.TEXT and message.data == "bye":
            break
        await (answer.send_str if message.type is WSMsgType.TEXT else answer.send_bytes)(message.data)
    return answer


@pytest.fixture
async def server() -> AsyncIterator[TestServer]:
    behind = web.Application()
    behind.router.add_get("/", _echo)
    async with TestServer(behind) as inner:
        assert inner.port is not None
        outer = TestServer(Front(_WORD, inner.port).application())
        async with outer:
            yield outer


async def test_texts_and_bytes_go_both_ways_until_the_server_ends_it(server: TestServer) -> None:
    async with ClientSession() as session:
        url = server.make_url("/").with_query(token=_WORD)
        async with session.ws_connect(url, protocols=[_SPOKEN]) as socket:
            assert socket.protocol == _SPOKEN
            await socket.send_str("{}")
            assert (await socket.receive()).data == "{}"
            await socket.send_bytes(bytes(100_000))
            assert (await socket.receive()).data == bytes(100_000)
            await socket.send_str("bye")
            assert (await socket.receive()).type is WSMsgType.CLOSE


@pytest.mark.parametrize("header", [None, "Bearer another-word-of-letters", f"Basic {_WORD}"])
async def test_who_does_not_know_the_word_is_not_let_in(server: TestServer, header: str | None) -> None:
    headers = {} if header is None else {"Authorization": header}
    async with ClientSession(headers=headers) as session:
        with pytest.raises(WSServerHandshakeError) as refused:
            await session.ws_connect(server.make_url("/"), protocols=[_SPOKEN])
        assert refused.value.status == 401


async def test_the_word_may_come_as_a_bearer_and_who_speaks_otherwise_is_told(server: TestServer) -> None:
    async with ClientSession(headers={"Authorization": f"bearer {_WORD}"}) as session:
        async with session.ws_connect(server.make_url("/"), protocols=[_SPOKEN]):
            pass
        with pytest.raises(WSServerHandshakeError) as refused:
            await session.ws_connect(server.make_url("/"), protocols=["other"])
        assert refused.value.status == 502


async def test_no_more_look_than_there_is_room_for(server: TestServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "_MOST", 1)
    url = server.make_url("/").with_query(token=_WORD)
    async with ClientSession() as session, session.ws_connect(url, protocols=[_SPOKEN]):
        with pytest.raises(WSServerHandshakeError) as refused:
            await session.ws_connect(url, protocols=[_SPOKEN])
        assert refused.value.status == 503
