"""Those who look: told the newest, held up by nobody, and no more than there is room for."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from companion.page.viewers import Viewers
from tests.page_messages import S, counts, vehicle
from tests.unit.companion.page.served import asking, events, page


async def test_a_viewer_is_told_what_is_and_what_is_new() -> None:
    async with page() as (viewers, server), asking(server) as session, session.get("/events") as answer:
        seen = events(answer)
        assert await anext(seen) == ("page", {"may_command": False})
        told: dict[str, Any] = {}
        while set(told) != {"path", "profile", "view"}:
            name, told[name] = await anext(seen)
        assert told["view"]["name"] == "uav" and told["profile"] is None
        viewers.take({"topic": "counts", "t_ns": 5 * S, "data": counts(3)})
        viewers.take({"topic": "/vehicle", "t_ns": 5 * S, "data": vehicle()})
        path: Any = None
        while path is None or not path["trail"]:
            name, data = await anext(seen)
            path = data if name == "path" else path
        assert path["trail"] == [[1.0, 2.0, 1.5]]
        assert viewers.count == 1


async def test_a_viewer_that_does_not_read_holds_up_nobody_and_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """It never reads; another one sees every picture meanwhile."""
    monkeypatch.setattr("companion.page.viewers._TAKES_S", 3.0)

    def tell(viewers: Viewers, number: int) -> None:
        bulk = {"number": number, "rows": 1, "columns": 1, "cells": "x" * 2_000_000}
        viewers.take({"topic": "/aoa/profile", "t_ns": S, "data": bulk})

    with socket.socket() as slow:
        async with page() as (viewers, server), asking(server) as session:
            slow.connect(("127.0.0.1", server.port))
            slow.sendall(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            while not viewers.count:  # noqa: ASYNC110 - it is polled
                await asyncio.sleep(0.01)
            async with session.get("/events") as answer:
                pictures = 0
                async for name, _ in events(answer):
                    tell(viewers, pictures)
                    pictures += name == "view"
                    if pictures == 8:
                        break
            async with asyncio.timeout(60):
                while viewers.count:
                    tell(viewers, viewers.count)
                    await asyncio.sleep(0.1)


async def test_no_more_look_than_there_is_room_for() -> None:
    async with page() as (viewers, server), asking(server) as session:
        viewers.count = 16
        assert (await session.get("/events")).status == 503
        viewers.count = 0


async def test_a_loop_that_stands_still_is_silence_though_its_feed_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    async with page() as (viewers, _):
        now_s = [100.0]
        monkeypatch.setattr("companion.page.viewers.time.monotonic", lambda: now_s[0])
        viewers.take({"topic": "counts", "t_ns": 5 * S, "data": counts(3)})
        now_s[0] = 109.0
        viewers.take({"topic": "counts", "t_ns": 5 * S, "data": counts(3)})
        assert viewers.silent_s() == 9.0
        assert viewers.model.items(viewers.silent_s())[0].text == "silent for 9 s"
        viewers.take({"topic": "counts", "t_ns": 6 * S, "data": counts(4)})
        assert viewers.silent_s() == 0.0
