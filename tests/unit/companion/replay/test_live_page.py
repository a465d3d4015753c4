"""The page of a replay: it follows the log, in a browser and for any program here, and says when it has ended."""

from __future__ import annotations

import json
import socket
import threading
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any, Final

import pytest

from companion.errors import CompanionError
from companion.log.reader import open_session
from companion.replay.live_page import LivePage, replay_with_page
from companion.replay.player import Player
from companion.replay.result import ReplayResult
from tests.browser import CHROMIUM
from tests.browser_session import Session
from tests.golden.golden_logs import GOLDEN
from tests.page_messages import known
from tests.paths import ROOT

_PATIENCE_S: Final = 300.0
"""Of a machine that is busy with other things."""
_SCREENS: Final = ROOT / "build" / "screens"
_STATE: Final = "document.getElementById('state')?.textContent"
_BEARING: Final = "document.getElementById('bearing')?.textContent"
_BANNER: Final = "document.getElementById('banner')?.textContent"
_INK: Final = """[...document.querySelectorAll('canvas')].map(one => {
  const seen = new Set(new Uint32Array(one.getContext('2d').getImageData(0, 0, one.width, one.height).data.buffer));
  return seen.size; })"""
"""How many colours each picture has."""


class Showing(threading.Thread):
    """A replay at a given speed with its page, which stays until `let_go`."""

    def __init__(self, speed: float) -> None:
        super().__init__()
        self._speed = speed
        self._ready, self._done = threading.Event(), threading.Event()
        self._url = ""
        self.result: ReplayResult | None = None

    def run(self) -> None:
        session = open_session(GOLDEN[0])
        with Player(session, session.config(), exact=True) as player:
            self.result = replay_with_page(player, session, self._speed, 0, announce=self._announce, stay=self._stay)

    def url(self) -> str:
        assert self._ready.wait(_PATIENCE_S)
        return self._url

    def let_go(self) -> None:
        self._done.set()
        self.join(_PATIENCE_S)

    def _stay(self) -> None:
        self._done.wait(_PATIENCE_S)

    def _announce(self, url: str) -> None:
        self._url = url
        self._ready.set()


def state(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url + "state", timeout=_PATIENCE_S) as answer:
        return json.loads(answer.read())  # type: ignore[no-any-return]


def until(url: str, is_so: Callable[[dict[str, Any]], bool]) -> list[dict[str, Any]]:
    states = [state(url)]
    pause = threading.Event()
    while not is_so(states[-1]):
        pause.wait(0.05)
        states.append(state(url))
    return states


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session | None]:
    """One for all, since it takes seconds to start; None where there is none."""
    if CHROMIUM is None:
        yield None
        return
    with Session(tmp_path_factory.mktemp("browser")) as session:
        yield session


def there(browser: Session | None) -> Session:
    """What went before needs no browser; the rest is skipped without one."""
    if browser is None:
        pytest.skip("no /usr/bin/chromium here (apt-get install chromium)")
    return browser


def test_a_browser_follows_a_replay_on_desktop_and_phone_to_its_end(browser: Session | None) -> None:
    showing = Showing(speed=4.0)
    showing.start()
    try:
        url = showing.url()
        assert url.startswith("http://127.0.0.1:")
        urllib.request.urlopen(url, timeout=_PATIENCE_S).close()  # it begins when somebody looks
        states = until(url, lambda seen: bool(seen["path"]["bearings"]) and seen["profile"] is not None)
        times = [one["view"]["t_s"] for one in states]
        assert times == sorted(times) and times[0] < times[-1]
        assert {(one["view"]["mission"] or {}).get("state") for one in states} & {"acquiring", "approaching"}
        last = until(url, lambda seen: bool(seen["view"]["ended"]))[-1]
        assert last["path"]["trail"] and last["view"]["rates"]["packets_hz"] > 50
        browser = there(browser)
        for name, width, height in (("desktop", 1280, 1200), ("phone", 390, 2200)):
            browser.size(width, height, is_phone=name == "phone")
            browser.open(url)
            assert "ended at" in browser.until(_BANNER, lambda text: "ended" in (text or ""))
            assert "° from East" in browser.until(_BEARING, lambda text: "Compass" in (text or ""))
            assert all(colours > 3 for colours in browser.until(_INK))
            assert browser.value("document.documentElement.scrollWidth") <= width
            browser.screenshot(_SCREENS / f"replay-{name}.png")
        assert browser.console == [] and browser.outside() == []
    finally:
        showing.let_go()
    assert showing.result is not None and showing.result.unexpected == 0


@pytest.mark.long
def test_a_page_lives_through_a_restart_of_its_service(browser: Session | None) -> None:
    browser = there(browser)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with LivePage(known(), port) as page:
        page.feed.tell("status", 1, {"state": "latched", "reason": "", "not_ready": []})
        browser.size(390, 844, is_phone=True)
        browser.open(page.url)
        assert browser.until(_STATE, lambda text: text == "latched")
    assert browser.until(_BANNER, lambda text: "lost its service" in (text or ""))
    assert browser.value(_STATE) == "latched"  # what was shown last stays
    browser.console.clear()  # the browser itself says that nobody answered
    with LivePage(known(), port) as page:
        page.feed.tell("status", 1, {"state": "idle", "reason": "", "not_ready": []})
        assert browser.until(_STATE, lambda text: text == "idle")
        assert "uav" in browser.until(_BANNER, lambda text: "lost" not in (text or "lost"))
        assert [line for line in browser.console if "ERR_CONNECTION" not in line] == []


def test_a_port_that_is_taken_is_named() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(CompanionError, match=f"--port {port}: .*in use"), LivePage(known(), port):
            pass
