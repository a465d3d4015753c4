"""The page's HTTP: who may look, who may command, what is served, and viewers that are slow."""

from __future__ import annotations

import asyncio
import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from companion.page.server import asset
from tests.browser_session import Session
from tests.control_socket import serving
from tests.unit.companion.page.served import WORD, asking, page


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
