"""The page of a replay: it follows the log, in a browser and for anybody on this machine, and then ends."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import urllib.request
from pathlib import Path
from typing import Any, Final

import pytest

from companion.log.reader import open_session
from companion.replay.live_page import replay_with_page
from companion.replay.player import Player
from companion.replay.result import ReplayResult
from tests.browser import CHROMIUM, visit
from tests.golden.golden_logs import GOLDEN

_PATIENCE_S: Final = 300.0
"""Of a machine that is busy with other things."""


class Showing(threading.Thread):
    """A replay at a given speed with its page."""

    def __init__(self, speed: float) -> None:
        super().__init__()
        self._speed = speed
        self._ready = threading.Event()
        self._url = ""
        self._task: asyncio.Task[Any] | None = None
        self.result: ReplayResult | None = None

    def run(self) -> None:
        session = open_session(GOLDEN[0])
        ended = contextlib.suppress(asyncio.CancelledError)
        with ended, Player(session, session.config(), exact=True) as player:
            self.result = replay_with_page(player, session, self._speed, 0, self._announce)

    def url(self) -> str:
        assert self._ready.wait(_PATIENCE_S)
        return self._url

    def end(self) -> None:
        """Wherever it is."""
        assert self._task is not None
        self._task.get_loop().call_soon_threadsafe(self._task.cancel)
        self.join(_PATIENCE_S)

    def _announce(self, url: str) -> None:
        self._url, self._task = url, asyncio.current_task()
        self._ready.set()


def state(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url + "state", timeout=_PATIENCE_S) as answer:
        return json.loads(answer.read())  # type: ignore[no-any-return]


def test_the_page_follows_the_replay() -> None:
    showing = Showing(speed=4.0)
    showing.start()
    url = showing.url()
    assert url.startswith("http://127.0.0.1:")
    states = [state(url)]
    urllib.request.urlopen(url, timeout=_PATIENCE_S).close()  # it begins when somebody looks
    while not states[-1]["bearings"] and not states[-1]["is_done"]:
        states.append(state(url))
    times = [one["t_s"] for one in states]
    assert times == sorted(times)
    assert times[0] < times[-1]
    assert states[-1]["bearings"]
    assert states[-1]["trail"]
    assert {one["status"].get("state") for one in states} & {"acquiring", "approaching"}
    showing.join(_PATIENCE_S)
    assert showing.result is not None
    assert showing.result.unexpected == 0


@pytest.mark.skipif(CHROMIUM is None, reason="no browser on this machine")
def test_a_browser_shows_the_page(tmp_path: Path) -> None:
    """The replay hardly moves meanwhile: however long the browser takes, it does not end under it."""
    showing = Showing(speed=1e-3)
    showing.start()
    try:
        seen = visit(showing.url(), tmp_path)
    finally:
        showing.end()
    assert seen.console == []
    assert seen.outside == []
    assert "path_m" in seen.dom
