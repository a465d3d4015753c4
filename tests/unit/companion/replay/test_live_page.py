"""The page of a replay: it follows the log, in a browser and for anybody on this machine, and then ends."""

from __future__ import annotations

import json
import threading
import time
import urllib.request
from pathlib import Path
from typing import Any

from companion.log.reader import open_session
from companion.replay.live_page import replay_with_page
from companion.replay.player import Player
from companion.replay.result import ReplayResult
from tests.browser import CHROMIUM, visit
from tests.golden.golden_logs import GOLDEN


class Showing(threading.Thread):
    """A replay at a given speed with its page."""

    def __init__(self, speed: float) -> None:
        super().__init__()
        self._speed = speed
        self._ready = threading.Event()
        self._url = ""
        self.result: ReplayResult | None = None

    def run(self) -> None:
        session = open_session(GOLDEN[0])
        with Player(session, session.config(), exact=True) as player:
            self.result = replay_with_page(player, session, self._speed, 0, self._announce)

    def url(self) -> str:
        assert self._ready.wait(30)
        return self._url

    def _announce(self, url: str) -> None:
        self._url = url
        self._ready.set()


def state(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url + "state", timeout=10) as answer:
        return json.loads(answer.read())  # type: ignore[no-any-return]


def test_the_page_follows_the_replay(tmp_path: Path) -> None:
    showing = Showing(speed=4.0)
    showing.start()
    url = showing.url()
    assert url.startswith("http://127.0.0.1:")
    if CHROMIUM is None:
        urllib.request.urlopen(url, timeout=10).close()  # it begins when somebody looks
    else:
        seen = visit(url, tmp_path)
        assert seen.console == []
        assert seen.outside == []
        assert "path_m" in seen.dom
    states: list[dict[str, Any]] = []
    while len(states) < 3 or (not states[-1]["bearings"] and not states[-1]["is_done"]):
        states.append(state(url))
        time.sleep(0.3)
    times = [one["t_s"] for one in states]
    assert times == sorted(times)
    assert times[0] < times[-1]
    assert states[-1]["bearings"]
    assert states[-1]["trail"]
    assert states[-1]["status"]["state"] in ("acquiring", "approaching")
    showing.join(60)
    assert showing.result is not None
    assert showing.result.unexpected == 0
