"""The page's HTTP: who may look, who may command, what is served, and viewers that are slow."""

from __future__ import annotations

import asyncio
import json
import re
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientResponse, ClientSession, CookieJar
from aiohttp.test_utils import TestServer

from companion.page.server import PageServer, PageSettings, asset
from companion.page.viewers import Viewers
from tests.browser_session import Session
from tests.control_socket import serving
from tests.page_messages import S, counts, known, vehicle

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


async def test_the_page_is_whole_and_asks_nobody_else() -> None:
    async with page() as (_, server), asking(server) as session:
        text = await (await session.get("/")).text()
        names = re.findall(r'(?:src|href)="([^"]+)"', text)
        assert "live.js" in names and 'name="viewport"' in text
        for name in names:
            if not name.startswith("data:"):
                answer = await session.get(f"/{name}")
                assert answer.status == 200
                assert not re.search(r"https?://|@import|url\(", await answer.text())
                assert "script-src 'self'" in answer.headers["Content-Security-Policy"]


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


async def test_without_a_word_only_names_of_this_host_are_answered() -> None:
    async with page() as (_, server), asking(server) as session:
        for host, status in (("localhost", 200), ("127.0.0.1:1", 200), ("[::1]:9", 200), ("evil.example", 403)):
            assert (await session.get("/state", headers={"Host": host})).status == status


async def test_a_word_opens_the_page_and_leaves_the_address() -> None:
    async with page(token=WORD) as (_, server):
        async with asking(server) as session:
            assert (await session.get("/state")).status == 401
            assert (await session.get("/state?token=wrong-wrong-wrong")).status == 401
            assert (await session.get("/healthz")).status == 200
            answer = await session.get(f"/?token={WORD}")
            assert answer.status == 200 and answer.url.query_string == ""
            assert (await session.get("/state")).status == 200
        async with asking(server) as session:
            assert (await session.get("/metrics", headers={"Authorization": f"Bearer {WORD}"})).status == 200
            assert (await session.get("/metrics", headers={"Authorization": "Bearer wrong"})).status == 401


async def test_commands_need_the_configuration_the_word_and_the_page_itself(tmp_path: Path) -> None:
    control, asked = tmp_path / "control.sock", list[str]()

    async def answer(command: str, target: str | None = None) -> dict[str, Any]:
        asked.append(command if target is None else f"{command} to {target}")
        return {"ok": command == "abort", "error": "" if command == "abort" else "no packets"}

    ours, bearer = {"X-Companion": "engage"}, {"Authorization": f"Bearer {WORD}"}
    async with serving(control, answer):
        asked.clear()
        async with page() as (_, server), asking(server) as session:
            assert (await session.post("/command/abort", headers=ours)).status == 403
        async with page(token=WORD) as (_, server), asking(server) as session:
            assert (await session.post("/command/abort", headers=ours | bearer)).status == 403
        async with page(token=WORD, control=control) as (_, server), asking(server) as session:
            assert (await session.post("/command/abort", headers=ours)).status == 401
            assert (await session.post("/command/abort", headers=bearer)).status == 403
            elsewhere = ours | bearer | {"Origin": "http://evil.example"}
            assert (await session.post("/command/abort", headers=elsewhere)).status == 403
            assert (await session.post("/command/status", headers=ours | bearer)).status == 404
            assert (await session.get("/command/abort", headers=ours | bearer)).status == 405
            assert asked == []
            done = await session.post("/command/abort", headers=ours | bearer)
            assert (done.status, await done.json()) == (200, {"ok": True, "error": ""})
            refused = await session.post("/command/engage", headers=ours | bearer)
            assert (refused.status, (await refused.json())["error"]) == (409, "no packets")
            assert asked == ["abort", "engage"]
            await session.post("/command/engage?target=beta", headers=ours | bearer)
            assert asked[-1] == "engage to beta"


async def test_a_service_that_is_gone_is_named(tmp_path: Path) -> None:
    headers = {"X-Companion": "abort", "Authorization": f"Bearer {WORD}"}
    async with page(token=WORD, control=tmp_path / "none.sock") as (_, server), asking(server) as session:
        answer = await session.post("/command/abort", headers=headers)
        assert answer.status == 409 and "no service" in (await answer.json())["error"]


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


async def test_a_person_engages_in_the_browser_and_confirms(tmp_path: Path) -> None:
    control, asked = tmp_path / "control.sock", list[str]()

    async def answer(command: str, target: str | None = None) -> dict[str, Any]:
        asked.append(command)
        return {"ok": False, "error": "no packets"}

    async with serving(control, answer), page(token=WORD, control=control) as (_, server):
        asked.clear()
        await asyncio.to_thread(_engage, str(server.make_url(f"/?token={WORD}")), tmp_path)
        assert asked == ["engage"]


def _engage(url: str, folder: Path) -> None:
    click = "[...document.querySelectorAll('button')].find(one => one.textContent === 'WORD').click()"
    with Session(folder) as browser:
        browser.open(url)
        browser.until("document.querySelectorAll('#page button').length", lambda count: count == 2)
        browser.value(click.replace("WORD", "engage"))
        assert "Hand the vehicle" in browser.value("document.getElementById('dialog').textContent")
        browser.value(click.replace("WORD", "No"))
        assert browser.value("document.getElementById('dialog')") is None
        browser.value(click.replace("WORD", "engage"))
        browser.value(click.replace("WORD", "Yes, engage"))
        browser.until("document.getElementById('page').textContent", lambda text: "refused: no packets" in text)
        assert browser.value("location.search") == ""
        assert [line for line in browser.console if "409" not in line] == []


async def test_health_is_of_the_feed(monkeypatch: pytest.MonkeyPatch) -> None:
    async with page() as (viewers, server), asking(server) as session:
        assert (await session.get("/healthz")).status == 200
        monkeypatch.setattr(viewers, "silent_s", lambda: 6.0)
        assert (await session.get("/healthz")).status == 503


def test_colours_rise_evenly_in_lightness() -> None:
    """Anchors of the scale: printed in grey it says the same."""
    anchors = re.search(r"const ANCHORS = (\[\[.*?\]\]);", asset("colours.js"))
    assert anchors is not None
    lightness = [row[0] for row in json.loads(anchors[1])]
    assert lightness == sorted(lightness) and lightness[-1] - lightness[0] > 75


async def test_who_leaves_the_page_engages_nobody_and_aborts_still(tmp_path: Path) -> None:
    done: list[str] = []

    async def answer(command: str, target: str | None = None) -> dict[str, Any]:
        await asyncio.sleep(0.0 if command == "hello" else 1.0)
        done.append(command)
        return {"ok": True, "error": ""}

    headers = {"X-Companion": "1", "Authorization": f"Bearer {WORD}"}
    path = tmp_path / "control.sock"
    async with serving(path, answer), page(WORD, path) as (_, server):
        for command in ("engage", "abort"):
            async with asking(server) as session:
                with suppress(TimeoutError):
                    async with asyncio.timeout(0.4):
                        await session.post(f"/command/{command}", headers=headers)
        await asyncio.sleep(1.5)
    assert done == ["hello", "abort"]
